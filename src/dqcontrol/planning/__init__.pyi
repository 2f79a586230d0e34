from .branches import branch_along as branch_along
from .certified_edges import (
    CertifiedEdges as CertifiedEdges,
    EdgeCheck as EdgeCheck,
)
from .plan import (
    Certificate as Certificate,
    Plan as Plan,
    plan as plan,
)
from .plan_to import PlanTo as PlanTo
