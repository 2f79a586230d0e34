"""Mass matrix and bias forces against Pinocchio, against energy, and against closed forms."""

# pyright: reportAttributeAccessIssue=false
import numpy as np
import pinocchio as pin
import pytest
from pinocchio_oracle import ARMS, model_of, symmetric

from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.robots import Inertia, SerialArm, chain_as_tree, load_robot

WEIGHED = [name for name in ARMS if load_robot(name).inertia is not None]


@pytest.mark.parametrize("name", WEIGHED)
def test_chains_against_pinocchio(name):
    arm, rng = load_robot(name), np.random.default_rng(1)
    model = model_of(arm)
    data, n = model.createData(), arm.configuration_size
    for _ in range(30):
        q, rates = rng.uniform(-2, 2, (2, n))
        mass, bias = symmetric(pin.crba(model, data, q)), pin.nonLinearEffects(model, data, q, rates)
        assert np.abs(arm.mass_matrix(q) - mass).max() <= 1e-12 * np.abs(mass).max()
        assert np.abs(arm.bias_forces(q, rates) - bias).max() <= 1e-12 * np.abs(bias).max()
    model.gravity.linear = np.array([1.0, -2.0, 3.0])
    bias = pin.nonLinearEffects(model, data, q, rates)
    assert np.abs(arm.bias_forces(q, rates, [1, -2, 3]) - bias).max() <= 1e-12 * np.abs(bias).max()


TREE = """<robot name="gripper"><link name="base"/>
{links}
<joint name="turn" type="revolute"><parent link="base"/><child link="palm"/><origin xyz="0 0 0.2" rpy="0.3 0 0"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2" effort="50"/></joint>
<joint name="left" type="prismatic"><parent link="palm"/><child link="one"/><origin xyz="0 0.02 0.1"/>
<axis xyz="0 1 0"/><limit lower="0" upper="0.05" velocity="1" effort="50"/></joint>
<joint name="right" type="prismatic"><parent link="palm"/><child link="two"/><origin xyz="0 -0.02 0.1"/>
<axis xyz="0 -1 0"/><limit lower="0" upper="0.05" velocity="1" effort="50"/>{mimic}</joint>
<joint name="tip" type="revolute"><parent link="two"/><child link="nail"/><origin xyz="0 0 0.1"/>
<axis xyz="1 0 0"/><limit lower="-2" upper="2" velocity="2" effort="50"/></joint></robot>"""
LINK = """<link name="{0}"><inertial><origin xyz="{1} 0.01 0.05"/><mass value="{2}"/>
<inertia ixx="0.02" iyy="0.03" izz="0.025" ixy="0.001" ixz="-0.002" iyz="0.003"/></inertial></link>"""
LINKS = "".join(
    LINK.format(name, 0.01 * i, 1 + 0.3 * i) for i, name in enumerate(("palm", "one", "two", "nail"))
)
MIMIC = '<mimic joint="left" multiplier="0.7" offset="0.01"/>'


def test_tree_whose_joints_follow_each_other(tmp_path):
    """Joints that follow have the mass matrix GᵀMG of the tree in which they move alone."""
    for name, mimic in (("free", ""), ("following", MIMIC)):
        (tmp_path / f"{name}.urdf").write_text(TREE.format(links=LINKS, mimic=mimic))
    free, following = (load_robot(tmp_path / f"{name}.urdf", tips="all") for name in ("free", "following"))
    model = pin.buildModelFromUrdf(str(tmp_path / "free.urdf"))
    q = np.array([0.4, 0.02, -0.7])
    rates = np.array([0.5, -0.3, 1.1])
    index = [following.joint_names.index(name) for name in ("turn", "left", "tip")]
    values, speeds = np.zeros((2, len(q)))
    values[index], speeds[index] = q, rates
    gather = np.zeros((4, 3))
    for name, column, factor in (("turn", 0, 1.0), ("left", 1, 1.0), ("right", 1, 0.7), ("tip", 2, 1.0)):
        gather[free.joint_names.index(name), index[column]] = factor
    every = gather @ values
    every[free.joint_names.index("right")] += 0.01
    order = [free.joint_names.index(name) for name in model.names[1:]]
    data, theirs = model.createData(), every[order]
    mass = np.zeros((4, 4))
    mass[np.ix_(order, order)] = symmetric(pin.crba(model, data, theirs))
    bias = np.zeros(4)
    bias[order] = pin.nonLinearEffects(model, data, theirs, (gather @ speeds)[order])
    assert np.abs(free.mass_matrix(every) - mass).max() < 1e-13
    assert np.abs(free.bias_forces(every, gather @ speeds) - bias).max() < 1e-13
    assert np.abs(following.mass_matrix(values) - gather.T @ mass @ gather).max() < 1e-13
    assert np.abs(following.bias_forces(values, speeds) - gather.T @ bias).max() < 1e-13


def test_a_chain_and_the_tree_of_it_are_the_same():
    arm = load_robot("iiwa7")
    tree, q, rates = chain_as_tree(arm), np.linspace(-1, 1, 7), np.linspace(1, -2, 7)
    assert np.abs(tree.mass_matrix(q) - arm.mass_matrix(q)).max() < 1e-14
    assert np.abs(tree.bias_forces(q, rates) - arm.bias_forces(q, rates)).max() < 1e-13


def test_pendulum_in_closed_form():
    body = Inertia(np.array([2.0]), np.array([[0.5, 0, 0]]), np.array([np.diag([0.1, 0.2, 0.3])]))
    quarter = [np.sqrt(0.5), np.sqrt(0.5), 0, 0, 0, 0, 0, 0]
    arm = SerialArm.from_dh([0], [0], [1], [0], inertia=body, base=quarter)
    for angle in (0.3, 2e5 + 0.3):  # also where sines are found the slow way
        assert abs(arm.mass_matrix([angle])[0, 0] - (0.3 + 2.0 * 0.25)) < 1e-15
        assert abs(arm.bias_forces([angle], [3.0])[0] - 2 * 9.81 * 0.5 * np.cos(angle)) < 1e-9


def test_power_of_gravity_and_acceleration_is_the_rate_of_energy():
    """With q̈ = 0 the bias does the work that kinetic and potential energy gain."""
    arm, rng, h = load_robot("panda"), np.random.default_rng(3), 1e-5
    q, rates = rng.uniform(-1, 1, (2, arm.configuration_size))
    kinetic = [0.5 * rates @ arm.mass_matrix(q + s * h * rates) @ rates for s in (1, -1)]
    lifted = arm.gravity_forces(q) @ rates
    gained = (kinetic[0] - kinetic[1]) / (2 * h) + lifted
    assert abs(arm.bias_forces(q, rates) @ rates - gained) < 1e-7


def test_batches_and_what_is_refused():
    arm = load_robot("iiwa7")
    q, rates = np.random.default_rng(2).uniform(-1, 1, (2, 4, 3, 7))
    assert arm.mass_matrix(q).shape == (4, 3, 7, 7)
    np.testing.assert_array_equal(arm.mass_matrix(q)[2, 1], arm.mass_matrix(q[2, 1].tolist()))
    np.testing.assert_array_equal(arm.bias_forces(q, rates)[2, 1], arm.bias_forces(q[2, 1], rates[2, 1]))
    np.testing.assert_array_equal(
        arm.bias_forces(q[0, 0], rates)[2, 1], arm.bias_forces(q[0, 0], rates[2, 1])
    )
    for call, error, text in (
        (lambda: load_robot("ax18").mass_matrix(np.zeros(5)), ValueRangeError, "inertia: ax18 has none"),
        (lambda: arm.mass_matrix(np.zeros(6)), ShapeError, "q: expected shape"),
        (lambda: arm.mass_matrix(np.full(7, np.nan)), ValueRangeError, "q: must be finite"),
        (lambda: arm.bias_forces(np.zeros(7), np.full(7, np.inf)), ValueRangeError, "rates: must be finite"),
        (lambda: arm.bias_forces(np.zeros(7), np.zeros(6)), ShapeError, "rates: expected shape"),
    ):  # fmt: skip
        with pytest.raises(error, match=text):
            call()
