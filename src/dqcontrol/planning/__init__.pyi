from .certified_edges import (
    CertifiedEdges as CertifiedEdges,
    EdgeCheck as EdgeCheck,
)
from .drive_and_plan import drive_and_plan as drive_and_plan
from .followed_path import branch_along as branch_along
from .plan import (
    ProvedWay as ProvedWay,
    WayCertificate as WayCertificate,
    plan as plan,
)
from .plan_to import (
    Again as Again,
    PlanTo as PlanTo,
)
