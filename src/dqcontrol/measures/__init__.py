"""Numbers that judge runs, and the tables that show them."""

from dqcontrol.measures.attenuation import Attenuation, Gammas, PremiseError, attenuation, attenuation_table
from dqcontrol.measures.attenuation_cases import verify_attenuation
from dqcontrol.measures.lyapunov import Certificate, certificate
from dqcontrol.measures.metric_tables import comparison_table, summary_table
from dqcontrol.measures.metrics import Metrics, evaluate
from dqcontrol.measures.repeat_tables import (
    confidence_table,
    differences_table,
    means_table,
    repeatability_table,
)
from dqcontrol.measures.tables import Column, PlusMinus, Table
from dqcontrol.measures.task_range import TaskRange, task_range

__all__ = [
    "Attenuation",
    "Certificate",
    "Column",
    "Gammas",
    "Metrics",
    "PlusMinus",
    "PremiseError",
    "Table",
    "TaskRange",
    "attenuation",
    "attenuation_table",
    "certificate",
    "comparison_table",
    "confidence_table",
    "differences_table",
    "evaluate",
    "means_table",
    "repeatability_table",
    "summary_table",
    "task_range",
    "verify_attenuation",
]
