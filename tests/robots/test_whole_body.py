"""Whole bodies against products of their parts, finite differences, Pinocchio and DQ Robotics."""
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (Pinocchio's compiled names are invisible to pyright)

import dqrobotics
import numpy as np
import pinocchio as pin
import pytest
from dqrobotics.robot_modeling import DQ_HolonomicBase, DQ_SerialWholeBody
from dqrobotics.robots import Ax18ManipulatorRobot, KukaYoubotRobot
from pinocchio_oracle import model_of, pose_matrix, se3

from dqcontrol import DualQuaternion, Kinematics, algebra
from dqcontrol.errors import Error, ShapeError, UnknownNameError, ValueRangeError
from dqcontrol.robots import (
    CarLikeBase,
    DifferentialDrive,
    HolonomicBase,
    Limits,
    MecanumBase,
    SerialArm,
    SteeredTricycle,
    WholeBody,
    load_robot,
)

SEED = 31
KINDS = ("pose", "twist", "translation", "rotation")
DRIVE, OTHER = DifferentialDrive(0.065, 0.13), DifferentialDrive(0.1, 0.2, displacement=-0.3)
FREE = HolonomicBase()
CAR = CarLikeBase(0.1, 0.2, wheelbase=0.5, steering_limit=0.6)
TRICYCLE = SteeredTricycle(0.1, 0.2, wheelbase=0.4, steering_limit=np.pi / 2)
MECANUM = MecanumBase(wheel_radius=0.05, half_track=0.15, half_wheelbase=0.25)
BASES = (DRIVE, OTHER, FREE, CAR, TRICYCLE, MECANUM)
MOUNT = DualQuaternion(algebra.exp_screw([0.1, 0.2, -0.3, 0.2, 0.1, 0.4]))
TOOL = DualQuaternion(algebra.exp_screw([-0.2, 0.1, 0.3, 0.0, 0.1, 0.2]))
IIWA, AX18, UR5 = load_robot("iiwa7"), load_robot("ax18"), load_robot("ur5")
SLIDER = SerialArm.from_dh([0, 0.3], [0.1, 0], [0.2, 0.3], [1.0, -0.5], ["prismatic", "revolute"])

BODIES = {
    "a drive": [DRIVE],
    "a holonomic base": [FREE],
    "a drive and an arm": [DRIVE, MOUNT, AX18],
    "a holonomic base and an arm": [FREE, MOUNT, AX18, TOOL],
    "an arm with a drive": [AX18, MOUNT, DRIVE, TOOL],
    "base, arm, base, arm": [DRIVE, MOUNT, AX18, OTHER, TOOL, IIWA],
    "an arm that carries another": [FREE, IIWA, TOOL, UR5],
    "drives on drives": [MOUNT, DRIVE, OTHER, FREE, DRIVE],
    "a reversed arm and a slider": [DRIVE, UR5.reversed(), FREE, SLIDER],
    "a car, a tricycle and mecanum wheels with arms": [CAR, MOUNT, AX18, TRICYCLE, MECANUM, TOOL],
    "arms only": [AX18, TOOL, SLIDER],
}


@pytest.fixture(params=BODIES, name="parts")
def _parts(request):
    return BODIES[request.param]


def size(part):
    return 3 if part in BASES else getattr(part, "configuration_size", 0)


def product(parts, q):
    """Return the end pose by definition: a base is r + ε½pr with p = (x, y, 0) and r about z."""
    pose = DualQuaternion.identity()
    for part in parts:
        own, q = q[: size(part)], q[size(part) :]
        if isinstance(part, SerialArm):
            pose = pose * DualQuaternion(part.fkm(own))
        elif isinstance(part, DualQuaternion):
            pose = pose * part
        else:
            half = own[2] / 2
            pose = pose * DualQuaternion.from_pose([np.cos(half), 0, 0, np.sin(half)], [own[0], own[1], 0])
    return pose.vec8


def velocity_map(parts, q):
    """Return G(q), shape (n, m), with q̇ = G u."""
    blocks = []
    for part in parts:
        own, q = q[: size(part)], q[size(part) :]
        if isinstance(part, DifferentialDrive | CarLikeBase | SteeredTricycle):
            blocks.append(np.array([[np.cos(own[2]), 0], [np.sin(own[2]), 0], [0, 1]]))
        else:
            blocks.append(np.eye(len(own)))
    rows, columns = np.sum([b.shape for b in blocks], axis=0)
    out, i, j = np.zeros((rows, columns)), 0, 0
    for block in blocks:
        out[i : i + block.shape[0], j : j + block.shape[1]] = block
        i, j = i + block.shape[0], j + block.shape[1]
    return out


def derivative(function, q, direction, h=1e-4):
    """Return the derivative of a function along a direction, fourth order."""
    f = [function(q + k * h * direction) for k in (-2, -1, 1, 2)]
    return (8 * (f[2] - f[1]) - (f[3] - f[0])) / (12 * h)


def close(actual, desired, atol):
    np.testing.assert_allclose(actual, desired, rtol=0, atol=atol)


def states(body, count=4):
    rng = np.random.default_rng(SEED)
    for _ in range(count):
        yield rng.uniform(-1.5, 1.5, body.configuration_size), rng.uniform(-1, 1, body.input_size)


def test_poses_are_products_of_the_parts(parts):
    body = WholeBody(parts)
    assert body.configuration_size == sum(size(part) for part in parts)
    for q, _ in states(body):
        close(body.fkm(q), product(parts, q), 1e-13)
        close(body.frames(q)[-1], body.fkm(q), 1e-14)


@pytest.mark.parametrize("form", ["constrained", "unconstrained"])
def test_jacobians(parts, form):
    body = WholeBody(parts, form=form)
    for q, _ in states(body):
        columns = [derivative(lambda at: product(parts, at), q, e) for e in np.eye(len(q))]
        jacobian = np.array(columns).T
        if form == "constrained":
            jacobian = jacobian @ velocity_map(parts, q)
        close(body.pose_jacobian(q), jacobian, 1e-8)
        close(body.rotation_jacobian(q), jacobian[:4], 1e-8)
        x = DualQuaternion(body.fkm(q))
        twists = [(DualQuaternion(2 * column) * x.conj()).vec8[[1, 2, 3, 5, 6, 7]] for column in jacobian.T]
        close(body.twist_jacobian(q), np.array(twists).T, 1e-8)

        def position(at):
            return pose_matrix(product(parts, at))[:3, 3]

        moved = np.array([derivative(position, q, e) for e in np.eye(len(q))]).T
        if form == "constrained":
            moved = moved @ velocity_map(parts, q)
        close(body.translation_jacobian(q), moved, 1e-8)
        fast = body.kinematics(q)
        close(fast.pose, body.fkm(q), 1e-14)
        np.testing.assert_array_equal(fast.pose_jacobian, body.pose_jacobian(q))
        np.testing.assert_array_equal(fast.twist_jacobian, body.twist_jacobian(q))


@pytest.mark.parametrize("form", ["constrained", "unconstrained"])
def test_derivatives_of_jacobians(parts, form):
    body = WholeBody(parts, form=form)
    for q, u in states(body):
        rates = velocity_map(parts, q) @ u if form == "constrained" else u
        for kind in KINDS:
            expected = derivative(getattr(body, f"{kind}_jacobian"), q, rates)
            close(getattr(body, f"{kind}_jacobian_derivative")(q, u), expected, 1e-7)


def test_moving_the_ground_moves_the_hand():
    body = WholeBody(BODIES["base, arm, base, arm"])
    ground = WholeBody([FREE])
    for q, _ in states(body):
        by = np.array([0.3, -0.7, 1.1])
        c, s = np.cos(by[2]), np.sin(by[2])
        moved = q.copy()
        moved[:3] = [by[0] + c * q[0] - s * q[1], by[1] + s * q[0] + c * q[1], by[2] + q[2]]
        shift = DualQuaternion(ground.fkm(by))
        close(body.fkm(moved), (shift * DualQuaternion(body.fkm(q))).vec8, 1e-13)
        turned = algebra.hamilton_plus(shift.vec8) @ body.pose_jacobian(q)
        close(body.pose_jacobian(moved), turned, 1e-13)


def test_batches_equal_singles():
    body = WholeBody(BODIES["base, arm, base, arm"])
    rng = np.random.default_rng(SEED)
    q = rng.uniform(-1, 1, (2, 3, body.configuration_size))
    u = rng.uniform(-1, 1, (2, 3, body.input_size))
    methods = [
        (getattr(body, name), 1) for name in ("fkm", "pose_jacobian", "twist_jacobian", "hand_jacobian")
    ]
    methods += [(getattr(body, f"{kind}_jacobian_derivative"), 2) for kind in KINDS]
    methods += [(lambda q, u: body.integrate(q, u, 0.1), 2), (body.input_map, 1)]
    for method, arguments in methods:
        batch = method(*(q, u)[:arguments])
        for i in np.ndindex(2, 3):
            np.testing.assert_array_equal(batch[i], method(*(q[i], u[i])[:arguments]))


def pinocchio_body(parts):
    """Build a Pinocchio model with planar joints, whose speeds are those along and across the base's own axes."""
    model, parent, place = pin.Model(), 0, pin.SE3.Identity()
    for k, part in enumerate(parts):
        if isinstance(part, DualQuaternion):
            place = place * pin.SE3(pose_matrix(part.vec8))
        elif isinstance(part, SerialArm):
            for i, kind in enumerate(part.joint_types):
                joint = pin.JointModelRZ() if kind == "revolute" else pin.JointModelPZ()
                parent = model.addJoint(parent, joint, place * se3(part.chain[i]), f"{k}/{i}")
                place = pin.SE3.Identity()
            place = se3(part.chain[-1])
        else:
            parent = model.addJoint(parent, pin.JointModelPlanar(), place, f"{k}")
            place = pin.SE3.Identity()
    model.addFrame(pin.Frame("tool", parent, 0, place, pin.FrameType.OP_FRAME))
    return model


def in_pinocchio(parts, q, u):
    """Return Pinocchio's configuration and speeds, and which of its columns are ours, turned into our axes."""
    configuration, speeds, turns, j = [], [], [], 0
    for part in parts:
        own, q = q[: size(part)], q[size(part) :]
        if isinstance(part, DifferentialDrive | CarLikeBase | SteeredTricycle):
            configuration += [own[0], own[1], np.cos(own[2]), np.sin(own[2])]
            speeds += [u[j], 0.0, u[j + 1]]
            turns.append(np.eye(3)[:, [0, 2]])
            j += 2
        elif isinstance(part, HolonomicBase):
            c, s = np.cos(own[2]), np.sin(own[2])
            turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])  # from ẋ, ẏ, φ̇
            configuration += [own[0], own[1], c, s]
            speeds += [*(turn @ u[j : j + 3])]
            turns.append(turn)
            j += 3
        elif len(own):
            configuration += [*own]
            speeds += [*u[j : j + len(own)]]
            turns.append(np.eye(len(own)))
            j += len(own)
    out, row, column = np.zeros((len(speeds), len(u))), 0, 0
    for turn in turns:
        out[row : row + turn.shape[0], column : column + turn.shape[1]] = turn
        row, column = row + turn.shape[0], column + turn.shape[1]
    return np.array(configuration), np.array(speeds), out


def test_pinocchio_agrees(parts):
    body, model = WholeBody(parts), pinocchio_body(parts)
    data, tool = model.createData(), model.getFrameId("tool")
    for q, u in states(body):
        configuration, speeds, turn = in_pinocchio(parts, q, u)
        pin.forwardKinematics(model, data, configuration, speeds, np.zeros(model.nv))
        pin.computeJointJacobians(model, data, configuration)
        pin.updateFramePlacements(model, data)
        close(pose_matrix(body.fkm(q)), data.oMf[tool].homogeneous, 1e-12)
        jacobian = pin.getFrameJacobian(model, data, tool, pin.WORLD) @ turn
        close(body.twist_jacobian(q), np.vstack([jacobian[3:], jacobian[:3]]), 1e-12)
        # the derivative of the Jacobian: the twist rate without acceleration of the inputs
        acceleration = np.zeros(model.nv)
        i = 0
        for part in parts:
            if isinstance(part, HolonomicBase):  # ẍ = ÿ = 0 in our axes is a turning acceleration in its own
                v = speeds[i : i + 3]
                acceleration[i : i + 2] = [v[2] * v[1], -v[2] * v[0]]
            i += size(part)
        pin.forwardKinematics(model, data, configuration, speeds, acceleration)
        pin.updateFramePlacements(model, data)
        rate = pin.getFrameAcceleration(model, data, tool, pin.WORLD)
        close(body.twist_jacobian_derivative(q, u) @ u, [*rate.angular, *rate.linear], 1e-11)


def test_youbot_is_that_of_dq_robotics():
    body, theirs = load_robot("youbot"), KukaYoubotRobot.kinematics()
    for q, _ in states(body):
        close(body.fkm(q), theirs.fkm(q).vec8(), 1e-14)
        close(body.pose_jacobian(q), theirs.pose_jacobian(q), 1e-14)


@pytest.mark.parametrize(("name", "back"), [("little-john", 0.0), ("little-john-wrist", 0.17)])
def test_little_john_is_that_of_dq_robotics(name, back):
    base = DQ_HolonomicBase()
    base.set_frame_displacement(1 + dqrobotics.E_ * 0.5 * 0.17 * dqrobotics.k_)
    theirs = DQ_SerialWholeBody(base)
    arm = Ax18ManipulatorRobot.kinematics()
    arm.set_effector(dqrobotics.DQ([1, 0, 0, 0, 0, -back / 2, 0, 0]))
    theirs.add(arm)
    body = load_robot(name).in_form("unconstrained")
    for q, _ in states(body):
        close(body.fkm(q), theirs.fkm(q).vec8(), 1e-14)
        close(body.pose_jacobian(q), theirs.pose_jacobian(q), 1e-14)


def test_names_limits_and_coordinates_of_inputs():
    fast = DifferentialDrive(0.05, 0.2, rim_speed=0.6)
    body = WholeBody([AX18, fast, HolonomicBase(speed=0.4, turn_rate=2.0)], name="test")
    assert body.joint_names == (*AX18.joint_names, "2/x", "2/y", "2/phi", "3/x", "3/y", "3/phi")
    assert body.input_names == (*AX18.joint_names, "2/v", "2/omega", "3/x", "3/y", "3/phi")
    assert body.input_types[5:] == ("prismatic", "revolute", "prismatic", "prismatic", "revolute")
    assert body.input_coordinates.tolist() == [0, 1, 2, 3, 4, 5, 7, 8, 9, 10]
    assert body.drives.tolist() == [[5, 0.1, 0.05, 0.2, 0.0, 0.2]]
    np.testing.assert_allclose(body.limits.velocity, [2, 2, 2, 2, 2, 0.6, 3.0, 0.4, 0.4, 2.0])
    np.testing.assert_array_equal(body.limits.upper, [*AX18.limits.upper, *np.full(6, np.inf)])
    np.testing.assert_array_equal(body.limits.lower, -body.limits.upper)
    assert repr(body) == "WholeBody('test', 11 coordinates, 10 inputs)"
    free = body.in_form("unconstrained")
    assert (free.input_names, free.name, free.form) == (body.joint_names, "test", "unconstrained")
    np.testing.assert_allclose(free.limits.velocity[5:8], [0.6, 0.6, 3.0])
    assert free.in_form("constrained").input_names == body.input_names


def test_arms_are_their_own_inputs():
    assert IIWA.input_names == IIWA.joint_names
    assert IIWA.input_coordinates.tolist() == list(range(7))
    assert IIWA.drives.shape == (0, 6)
    alone = WholeBody([IIWA])
    np.testing.assert_array_equal(alone.twist_jacobian(np.ones(7)), IIWA.twist_jacobian(np.ones(7)))
    np.testing.assert_array_equal(alone.gravity_forces(np.ones(7)), IIWA.gravity_forces(np.ones(7)))


def test_whole_bodies_as_parts():
    first, second = WholeBody([DRIVE, AX18]), WholeBody([MOUNT, FREE, UR5], form="unconstrained")
    nested, flat = WholeBody([first, TOOL, second]), WholeBody([DRIVE, AX18, TOOL, MOUNT, FREE, UR5])
    q = np.linspace(-1, 1, 17)
    assert nested.input_names == flat.input_names
    np.testing.assert_array_equal(nested.pose_jacobian(q), flat.pose_jacobian(q))


@pytest.mark.parametrize("source", ["panda", "tiago"])
def test_a_base_under_an_arm_of_a_urdf(source):
    arm = {
        "panda": lambda: load_robot(
            "example-robot-data:panda_description/urdf/panda.urdf", tip_link="panda_hand"
        ),
        "tiago": lambda: load_robot(
            "example-robot-data:tiago_description/robots/tiago_no_hand.urdf",
            "base_footprint",
            "arm_tool_link",
        ),
    }[source]()
    body = WholeBody([DifferentialDrive(0.0985, 0.2022), arm])
    names = body.joint_names
    assert body.input_names == ("v", "omega", *names[3:])
    assert (names[3] == "torso_lift_joint") == (source == "tiago")
    model = pinocchio_body(body.parts)
    q, u = next(states(body))
    configuration, _, turn = in_pinocchio(body.parts, q, u)
    jacobian = pin.computeFrameJacobian(
        model, model.createData(), configuration, model.getFrameId("tool"), pin.WORLD
    )
    jacobian = jacobian @ turn
    close(body.twist_jacobian(q), np.vstack([jacobian[3:], jacobian[:3]]), 1e-12)


def test_a_configuration_for_a_pose_far_away():
    body = load_robot("little-john")
    pose = body.fkm([5, -7, 2, 0.3, 0.4, 0.5, 0.6, 0.7])
    found = body.solve(pose)
    assert found.success
    close(np.abs(body.fkm(found.q)), np.abs(pose), 1e-5)


def test_the_model_of_arms_serves_a_holonomic_body():
    body, model = load_robot("youbot"), model_of(load_robot("youbot"))
    q, u = next(states(body))
    data = model.createData()
    pin.computeJointJacobiansTimeVariation(model, data, q, u)
    pin.updateFramePlacements(model, data)
    rate = pin.getFrameJacobianTimeVariation(model, data, model.getFrameId("tool"), pin.WORLD)
    close(body.twist_jacobian_derivative(q, u), np.vstack([rate[3:], rate[:3]]), 1e-12)


BAD_PARTS = [
    ([], ShapeError, "parts: expected at least one base or arm, got 0 parts without any"),
    ([MOUNT], ShapeError, "parts: expected at least one base or arm, got 1 parts without any"),
    (DRIVE, ShapeError, "parts: expected a list of bases, arms and poses, got DifferentialDrive"),
    ([DRIVE, "panda"], ShapeError, r"parts\[1\]: expected a base, an arm, .* or a pose .*, got 'panda'"),
    ([DRIVE, [1, 0, 0, 0]], ShapeError, r"parts\[1\]: expected a base, an arm"),
    ([DRIVE, [[1, 2], [3]]], ShapeError, r"parts\[1\]: expected a base, an arm"),
    ([DRIVE, None], ShapeError, r"parts\[1\]: expected a base, an arm"),
    (
        [DRIVE, [2, 0, 0, 0, 0, 0, 0, 0]],
        ValueRangeError,
        r"parts\[1\]: expected unit dual quaternions, got norm 2",
    ),
    ([HolonomicBase], ShapeError, r"parts\[0\]: expected a base"),
]


@pytest.mark.parametrize(("parts_given", "error", "text"), BAD_PARTS)
def test_bad_parts(parts_given, error, text):
    with pytest.raises(error, match=text):
        WholeBody(parts_given)


BAD_BASES = [
    (lambda: DifferentialDrive(0, 0.1), "wheel_radius: must be > 0, got 0"),
    (lambda: DifferentialDrive(0.1, 0.0), "half_track: must be > 0, got 0"),
    (lambda: DifferentialDrive(0.1, -0.1), "half_track: must be > 0, got -0.1"),
    (lambda: DifferentialDrive(0.1, 0.1, 0), "displacement: must not be 0"),
    (lambda: DifferentialDrive(0.1, 0.1, np.nan), "displacement: must be finite"),
    (lambda: DifferentialDrive(0.1, 0.1, rim_speed=0), "rim_speed: must be > 0, got 0"),
    (lambda: DifferentialDrive("wide", 0.1), "wheel_radius: expected real numbers, got 'wide'"),
    (lambda: DifferentialDrive([0.1, 0.1], 0.1), r"wheel_radius: expected a single number, got shape \(2,\)"),
    (lambda: HolonomicBase(speed=-1), "speed: must be > 0, got -1"),
    (lambda: HolonomicBase(turn_rate=-np.inf), "turn_rate: must be finite"),
]


@pytest.mark.parametrize(("make", "text"), BAD_BASES)
def test_bad_bases(make, text):
    with pytest.raises(Error, match=text):
        make()


def test_bad_arguments():
    body = WholeBody([DRIVE, AX18])
    with pytest.raises(UnknownNameError, match="form: unknown name 'constraint'; did you mean 'constrained'"):
        WholeBody([DRIVE], form="constraint")
    with pytest.raises(
        ShapeError, match=r"u: expected shape \(…, 7\), got shape \(8,\); the inputs of .* are v, omega"
    ):
        body.pose_jacobian_derivative(np.zeros(8), np.zeros(8))
    with pytest.raises(
        ShapeError, match=r"u: expected shape \(…, 8\), got shape \(7,\); the inputs of .* are x, y, phi"
    ):
        body.in_form("unconstrained").twist_jacobian_derivative(np.zeros(8), np.zeros(7))
    with pytest.raises(
        ShapeError, match=r"q: expected shape \(8,\) for differential-drive\+ax18, got \(7,\)"
    ):
        body.kinematics(np.zeros(7))
    with pytest.raises(ShapeError, match=r"out: made for 8 inputs, but differential-drive.* has 7"):
        body.kinematics(np.zeros(8), Kinematics(8))
    with pytest.raises(ValueRangeError, match="q: must be finite"):
        body.kinematics(np.array([0, 0, np.nan, 0, 0, 0, 0, 0]))
    with pytest.raises(ValueRangeError, match=r"inertia: .* has none"):
        body.gravity_forces(np.zeros(8))
    with pytest.raises(ShapeError, match=r"^limits: expected Limits or None, got \(\[0\], \[1\]\)$"):
        SerialArm.from_dh([0], [0], [1], [0], limits=([0], [1]))
    with pytest.raises(ValueRangeError, match="joint 1 has lower 1 ≥ upper -1; lower must be below upper"):
        Limits([1.0], [-1.0], [1.0], [1.0])
    with pytest.raises(ShapeError, match=r"limits.effort: expected shape \(2,\), got \(3,\)"):
        Limits(-np.ones(3), np.ones(3), np.ones(2), np.ones(3))
    with pytest.raises(ShapeError, match="limits: the arm has 1 joints, got 2 entries"):
        SerialArm.from_dh([0], [0], [1], [0], limits=Limits([-1.0], [1.0], [1.0, 1.0], [1.0, 1.0]))
