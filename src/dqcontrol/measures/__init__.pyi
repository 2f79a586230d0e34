from .attenuation import (
    Attenuation as Attenuation,
    Gammas as Gammas,
    PremiseError as PremiseError,
    attenuation as attenuation,
    attenuation_table as attenuation_table,
    verify_attenuation as verify_attenuation,
)
from .lyapunov import (
    Certificate as Certificate,
    certificate as certificate,
)
from .metric_tables import (
    comparison_table as comparison_table,
    summary_table as summary_table,
)
from .metrics import (
    Metrics as Metrics,
    evaluate as evaluate,
)
from .repeats import (
    confidence_table as confidence_table,
    differences_table as differences_table,
    mean_of as mean_of,
    means_table as means_table,
    repeatability_table as repeatability_table,
)
from .stability import gain_limits as gain_limits
from .task_range import (
    TaskRange as TaskRange,
    task_range as task_range,
)
