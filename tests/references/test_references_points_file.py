import numpy as np
import pytest
from reference_samples import QUARTER, START

from dqcontrol import algebra, references as r
from dqcontrol.errors import FileFormatError, ValueRangeError

POSES = np.array([START, -QUARTER, -np.eye(8)[0]])  # the signs that do not jump
POSITIONS = algebra.translation(POSES)
TIMES = np.array([10.0, 11.5, 12.0])


def write(path, names, *columns):
    rows = np.column_stack(columns)
    lines = [", ".join(names), *(", ".join(f"{value:.17g}" for value in row) for row in rows)]
    path.write_text("# recorded\n\n" + "\n".join(lines) + "\n")
    return path


def test_positions_take_the_orientation_of_the_start(tmp_path):
    path = write(tmp_path / "p.csv", ["x", "y", "z"], POSITIONS)
    points = r.load_points(path, start=START, duration=3.0)
    poses = points.samples([0.0, 1.5, 3.0])[:, :8]
    np.testing.assert_allclose(poses, algebra.pose(START[:4], POSITIONS), atol=1e-14)


def test_positions_and_quaternions_with_times(tmp_path):
    names = ["x", "y", "z", "qw", "qx", "qy", "qz", "time"]
    points = r.load_points(write(tmp_path / "p.csv", names, POSITIONS, POSES[:, :4], TIMES))
    assert points.duration == 2.0
    np.testing.assert_allclose(points.samples([0.0, 1.5, 2.0])[:, :8], POSES, atol=1e-14)


def test_dual_quaternions_in_any_order_of_columns(tmp_path):
    names = ["dz", "TIME", "pw", "px", "py", "pz", "dw", "dx", "dy"]
    path = write(tmp_path / "p.csv", names, POSES[:, 7], TIMES, POSES[:, :7])
    np.testing.assert_allclose(r.load_points(path).samples([0.0, 1.5, 2.0])[:, :8], POSES, atol=1e-14)


def test_few_digits_are_normalised(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("time,x,y,z,qw,qx,qy,qz\n0,0,0,0,0.707,0.707,0,0\n1,0,0,1,0.707,0.707,0,0\n")
    pose = r.load_points(path).samples([0.0])[0, :8]
    np.testing.assert_allclose(pose, [0.5**0.5, 0.5**0.5, 0, 0, 0, 0, 0, 0], atol=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"p.csv:1: expected the columns x, y, z; or x, y, z, qw, .* got none"),
        ("x,y,zz\n", r"p.csv:1: unknown column 'zz'; did you mean 'z'\? \(allowed: time, x, y, z, qw"),
        ("x,y\n", r"p.csv:1: expected the columns x, y, z; or .* got x, y"),
        ("x,y,z,pw\n", r"p.csv:1: expected the columns"),
        ("x,y,z,x\n", r"p.csv:1: column 'x' is there 2 times"),
        ("0,0,0\n1,0,0\n", r"p.csv:1: unknown column '0'"),
        ("time,x,y,z\n0,0,0,0\n1,0,0\n", r"p.csv:3: expected 4 values \(time, x, y, z\), got 3"),
        ("time,x,y,z\n0,0,0,0\n1,0,,0\n", r"p.csv:3: y: expected a number, got ''"),
        ("time,x,y,z\n0,0,0,0\n\n1,0,nan,0\n", r"p.csv:4: y: must be finite, got nan"),
        ("time,x,y,z\n0,0,0,0\n", r"p.csv: expected at least two points, got 1"),
        ("time,x,y,z\n0,0,0,0\n1,0,0,0\n1,0,0,1\n", r"p.csv:4: time: must increase, got 1 after 1"),
        (
            "time,x,y,z,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n1,0,0,0,1,1,0,0\n",
            r"p.csv:3: qw … qz: must have norm 1, got 1.41",
        ),
        (
            "time,pw,px,py,pz,dw,dx,dy,dz\n0,1,0,0,0,0,0,0,0\n1,1,0,0,0,1,0,0,0\n",
            r"p.csv:3: pw … dz: .* 1 \+ ε 1",
        ),
        (
            "time,x,y,z,qw,qx,qy,qz\n0,0,0,0,0,0,0,0\n1,0,0,0,1,0,0,0\n",
            r"p.csv:2: qw … qz: must have norm 1, got 0",
        ),
    ],
)
def test_bad_files(text, message, tmp_path):
    path = tmp_path / "p.csv"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=message):
        r.load_points(path, start=START)


@pytest.mark.parametrize(
    ("names", "arguments", "message"),
    [
        ("x,y,z", {"start": START}, r"duration: .*p.csv has no column 'time'"),
        ("x,y,z", {"start": START, "duration": 0}, r"duration: must be > 0, got 0"),
        (
            "time,x,y,z",
            {"start": START, "duration": 2},
            r"duration: .*p.csv has its own column 'time', got 2 besides",
        ),
        ("time,x,y,z", {}, r"start: .*p.csv gives no orientation"),
        ("time,x,y,z", {"start": np.ones(8)}, r"start: expected a unit dual quaternion"),
    ],
)
def test_bad_arguments(names, arguments, message, tmp_path):
    path = tmp_path / "p.csv"
    count = len(names.split(","))
    path.write_text("\n".join([names, ",".join("0" * count), ",".join("1" * count)]))
    with pytest.raises(ValueRangeError, match=message):
        r.load_points(path, **arguments)


def test_missing_file(tmp_path):
    with pytest.raises(FileFormatError, match=r"none.csv: no such file"):
        r.load_points(tmp_path / "none.csv")


def test_plain_lines_of_three_numbers_as_p16_wrote_its_paths(tmp_path):
    """Divided by blanks, one point a sample: a segment lasts as long as it has points."""
    file = tmp_path / "path.txt"
    file.write_text(
        "# x y z\n0.5  0.1\t0.4\n0.5 0.2 0.4 # a corner\n\n0.5 0.2 0.5\n0.5 0.2 0.6\n0.5 0.2 0.7\n"
    )
    points = r.load_points(file, start=[1, 0, 0, 0, 0, 0, 0, 0], duration=4.0)
    found = algebra.translation(points.samples([0.0, 1.0, 4.0])[:, :8])
    np.testing.assert_allclose(found, [[0.5, 0.1, 0.4], [0.5, 0.2, 0.4], [0.5, 0.2, 0.7]], atol=1e-15)
    file.write_text("0.5 0.1 0.4\n0.5 0.2\n")
    with pytest.raises(FileFormatError, match=r"path\.txt:2: expected 3 values \(x, y, z\), got 2"):
        r.load_points(file, start=[1, 0, 0, 0, 0, 0, 0, 0], duration=4.0)


def test_streamed_points_have_no_twists(tmp_path):
    (tmp_path / "a.csv").write_text("time, x, y, z\n0, 0, 0, 0\n1, 0.1, 0, 0\n2, 0.1, 0.2, 0\n")
    start = [1.0, 0, 0, 0, 0, 0, 0, 0]
    known, streamed = (r.load_points(tmp_path / "a.csv", start, streamed=each) for each in (False, True))
    times = np.array([0.0, 0.4, 1.0, 1.7, 2.0])
    np.testing.assert_array_equal(streamed.samples(times)[:, :8], known.samples(times)[:, :8])
    assert not streamed.samples(times)[:, 8:20].any()
    assert known.samples(times)[:, 8:14].any()
    assert len(streamed.corners) == 0
