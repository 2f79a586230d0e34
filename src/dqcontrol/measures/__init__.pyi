from .attenuation import (
    Attenuation as Attenuation,
)
from .attenuation import (
    Gammas as Gammas,
)
from .attenuation import (
    PremiseError as PremiseError,
)
from .attenuation import (
    attenuation as attenuation,
)
from .attenuation import (
    attenuation_table as attenuation_table,
)
from .attenuation_cases import verify_attenuation as verify_attenuation
from .lyapunov import (
    Certificate as Certificate,
)
from .lyapunov import (
    certificate as certificate,
)
from .metric_tables import (
    comparison_table as comparison_table,
)
from .metric_tables import (
    summary_table as summary_table,
)
from .metrics import (
    Metrics as Metrics,
)
from .metrics import (
    evaluate as evaluate,
)
from .repeat_tables import (
    confidence_table as confidence_table,
)
from .repeat_tables import (
    differences_table as differences_table,
)
from .repeat_tables import (
    means_table as means_table,
)
from .repeat_tables import (
    repeatability_table as repeatability_table,
)
from .tables import (
    Column as Column,
)
from .tables import (
    PlusMinus as PlusMinus,
)
from .tables import (
    Table as Table,
)
from .task_range import (
    TaskRange as TaskRange,
)
from .task_range import (
    task_range as task_range,
)
