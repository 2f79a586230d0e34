from .excitation import (
    Excitation as Excitation,
    excite as excite,
)
from .identification import (
    Identification as Identification,
    identify as identify,
)
from .joint_gates import JointIdentification as JointIdentification
