"""The 3DGS PLY file: round trip, layout as an independent reader sees it, damaged files."""

import numpy as np
import pytest
import trimesh

from gsbridge.errors import InputError
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.ply import PROPERTIES, read_ply, write_ply


def random_cloud(count: int) -> Cloud:
    rng = np.random.default_rng(3)
    quats = rng.normal(size=(count, 4))
    return Cloud(
        rng.normal(size=(count, 3)),
        quats / np.linalg.norm(quats, axis=1, keepdims=True),
        rng.uniform(0.0005, 0.01, (count, 3)),
        rng.uniform(0.01, 0.99, count),
        rng.uniform(0, 1, (count, 3)),
    )


def test_round_trip(tmp_path):
    cloud = random_cloud(200)
    write_ply(tmp_path / "splats.ply", cloud)
    back = read_ply(tmp_path / "splats.ply")
    for name in ("means", "quats", "scales", "opacities", "colours"):
        np.testing.assert_allclose(getattr(back, name), getattr(cloud, name), rtol=2e-6, atol=1e-6)


def test_an_independent_reader_finds_the_viewers_layout(tmp_path):
    cloud = random_cloud(20)
    write_ply(tmp_path / "splats.ply", cloud)
    loaded = trimesh.load(tmp_path / "splats.ply")
    data = loaded.metadata["_ply_raw"]["vertex"]["data"]
    assert data.dtype.names == PROPERTIES
    np.testing.assert_allclose(np.exp(data["scale_1"]), cloud.scales[:, 1], rtol=1e-5)
    np.testing.assert_allclose(1 / (1 + np.exp(-data["opacity"])), cloud.opacities, rtol=1e-5)
    np.testing.assert_allclose(0.5 + 0.28209479 * data["f_dc_2"], cloud.colours[:, 2], atol=1e-6)
    np.testing.assert_allclose(data["rot_0"], cloud.quats[:, 0], atol=1e-6)


def test_extremes_stay_finite(tmp_path):
    flat = Cloud(np.zeros((2, 3)), np.eye(4)[:2], np.zeros((2, 3)), np.array([0.0, 1.0]), np.array([[0, 0, 0], [1, 1, 1]]))
    write_ply(tmp_path / "splats.ply", flat)
    back = read_ply(tmp_path / "splats.ply")
    np.testing.assert_allclose(back.opacities, [0, 1], atol=1e-5)
    assert (back.scales > 0).all()


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_harmonics_lie_channel_by_channel_before_the_opacity(tmp_path, degree):
    terms, plain = (0, 3, 8, 15)[degree], random_cloud(20)
    harmonics = np.random.default_rng(degree).normal(size=(20, terms, 3)).astype(np.float32)
    cloud = Cloud(plain.means, plain.quats, plain.scales, plain.opacities, plain.colours, harmonics)
    write_ply(tmp_path / "splats.ply", cloud)
    data = trimesh.load(tmp_path / "splats.ply").metadata["_ply_raw"]["vertex"]["data"]
    names = [f"f_rest_{k}" for k in range(3 * terms)]
    assert data.dtype.names == (*PROPERTIES[:9], *names, *PROPERTIES[9:])
    for channel in range(3):
        for k in range(terms):
            np.testing.assert_array_equal(data[f"f_rest_{channel * terms + k}"], harmonics[:, k, channel])
    back = read_ply(tmp_path / "splats.ply")
    np.testing.assert_array_equal(back.harmonics, harmonics)
    np.testing.assert_allclose(back.opacities, cloud.opacities, rtol=2e-6)
    assert back.sh_degree == degree


def test_harmonics_of_no_degree_are_refused(tmp_path):
    plain = random_cloud(3)
    cloud = Cloud(plain.means, plain.quats, plain.scales, plain.opacities, plain.colours, np.ones((3, 3, 3)))
    write_ply(tmp_path / "splats.ply", cloud)
    content = (tmp_path / "splats.ply").read_bytes()
    (tmp_path / "splats.ply").write_bytes(content.replace(b"f_rest_4", b"f_else_4"))
    with pytest.raises(InputError, match="8 f_rest"):
        read_ply(tmp_path / "splats.ply")


def test_other_properties_and_elements_are_passed_over(tmp_path):
    names = [*PROPERTIES[:9], "beauty", *PROPERTIES[9:]]
    header = "ply\nformat binary_little_endian 1.0\ncomment made elsewhere\nelement vertex 2\n"
    header += "".join(f"property float {name}\n" for name in names) + "element face 0\nproperty list uchar int vertex_indices\n"
    table = np.ones((2, len(names)), "<f4")
    (tmp_path / "other.ply").write_bytes((header + "end_header\n").encode() + table.tobytes())
    cloud = read_ply(tmp_path / "other.ply")
    np.testing.assert_allclose(cloud.quats, 0.5)
    np.testing.assert_allclose(cloud.scales, np.e, rtol=1e-6)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda data: b"", "no PLY file"),
        (lambda data: b"not a splat file at all", "no PLY file"),
        (lambda data: data[:120], "no PLY file"),
        (lambda data: data[:-30], "cut off"),
        (lambda data: data.replace(b"f_dc_1", b"f_xx_1"), "f_dc_1 missing"),
        (lambda data: data.replace(b"binary_little_endian", b"ascii"), "little-endian"),
        (lambda data: data.replace(b"element vertex 5", b"element vertex 0"), "no splat"),
        (lambda data: data.replace(b"element vertex 5", b"element vertex x"), "number of vertices"),
        (lambda data: data.replace(b"property float x", b"property quad x"), "not understood"),
        (lambda data: data[:-4] + np.float32(np.nan).tobytes(), "no number"),
    ],
)
def test_a_damaged_file_gives_one_clear_line(tmp_path, damage, words):
    path = tmp_path / "splats.ply"
    write_ply(path, random_cloud(5))
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(InputError, match=words) as caught:
        read_ply(path)
    assert str(path) in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.ply"):
        read_ply(tmp_path / "nothing.ply")
