from .certified_edges import (
    CertifiedEdges as CertifiedEdges,
    EdgeCheck as EdgeCheck,
)
