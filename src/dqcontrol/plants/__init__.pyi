from .compliant import CompliantPlant as CompliantPlant
from .compliant.loads_and_faults import (
    EncoderLoss as EncoderLoss,
    Payload as Payload,
    PayloadCompensation as PayloadCompensation,
    Push as Push,
    WristFault as WristFault,
)
from .coppeliasim import CoppeliaPlant as CoppeliaPlant
from .disturbance import (
    BandLimitedTwist as BandLimitedTwist,
    ConstantTwist as ConstantTwist,
    Disturbance as Disturbance,
    SinusoidalTwist as SinusoidalTwist,
    WorstCase as WorstCase,
)
from .drivers import (
    Driver as Driver,
    FrankaArm as FrankaArm,
    LeRobotArm as LeRobotArm,
    UniversalRobot as UniversalRobot,
    XArm as XArm,
)
from .integrator import Integrator as Integrator
from .mobile import MobilePlant as MobilePlant
from .mobile.odometry import Odometry as Odometry
from .mobile.wheeled_base import WheeledBase as WheeledBase
from .mujoco import MujocoPlant as MujocoPlant
from .mujoco.gripper import (
    Gripper as Gripper,
    GripperEvent as GripperEvent,
    Pads as Pads,
)
from .own_plant import OwnPlant as OwnPlant
from .plant import (
    Channel as Channel,
    CompiledPlant as CompiledPlant,
    Plant as Plant,
    PlantProtocol as PlantProtocol,
    RunningPlant as RunningPlant,
    lagging_mode as lagging_mode,
    limits_before as limits_before,
)
from .sensors import (
    Camera as Camera,
    FiducialLoss as FiducialLoss,
    Wrist as Wrist,
)
from .servo import (
    Servo as Servo,
    load_servo as load_servo,
)
