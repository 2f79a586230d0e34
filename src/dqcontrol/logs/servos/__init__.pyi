from .excitation import (
    Excitation as Excitation,
)
from .excitation import (
    excite as excite,
)
from .identification import (
    Identification as Identification,
)
from .identification import (
    identify as identify,
)
from .joint_gates import JointIdentification as JointIdentification
