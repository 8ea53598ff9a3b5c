"""The recording of trials, read back."""

import numpy as np
import pytest
from recording_file import read_recording
from trial_files import write_trials

from gsbridge.report.figures.paired_trials import failures_first, read_starts
from gsbridge.report.recordings import trials as module
from gsbridge.report.recordings.trials import hand_lines, record_trials
from gsbridge.report.tables.result_paths import CellPaths
from gsbridge.splats.cloud import Cloud

CELL = CellPaths("grasp", "mug", "table")
FAILED = {("unseen", 16): "not_grasped"}


class BundleStub:
    """An asset of three splats."""

    def cloud(self) -> Cloud:
        return Cloud(np.eye(3), np.tile([1.0, 0, 0, 0], (3, 1)), np.full((3, 3), 0.01), np.full(3, 0.5), np.full((3, 3), 0.2))


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "read_asset", lambda path: BundleStub())
    return [write_trials(tmp_path, "sim", states=6), write_trials(tmp_path, "mirror", shift=0.01, states=9, failed=FAILED)]


def values(found: dict, entity: str, component: str) -> list:
    return [value.as_py() for value in found[entity]["components"][component]]


def test_every_state_of_every_trial_is_recorded_failures_first(files, tmp_path):
    record_trials(CELL, files, "item", "background", tmp_path / "out.rrd")
    found, starts = read_recording(tmp_path / "out.rrd"), failures_first(read_starts(files))
    for world in ("sim", "mirror"):
        paths = [start.trials[world].path for start in starts]
        blobs = [bytes(value[0]) for value in values(found, f"/{world}/picture", "EncodedImage:blob")]
        assert blobs == [jpeg for path in paths for jpeg in path.jpegs]
        moved = [value[0] for value in values(found, f"/{world}/table/object", "Transform3D:translation")]
        np.testing.assert_allclose(moved, np.concatenate([path.object_position for path in paths]), atol=1e-6)
        turned = [value[0] for value in values(found, f"/{world}/table/object", "Transform3D:quaternion")]
        np.testing.assert_allclose(turned, np.tile([0.0, 0.0, 0.6, 0.8], (len(moved), 1)), atol=1e-6)
        forces = np.array(values(found, f"/plots/forces/{world}", "Scalars:scalars"))
        known = np.concatenate([np.r_[path.forces, np.full((1, 4), np.nan)] for path in paths])
        np.testing.assert_allclose(forces, known)
        actions = np.array(values(found, f"/plots/actions/{world}", "Scalars:scalars"))
        assert np.nansum(actions) == pytest.approx(sum(path.actions.sum() for path in paths))
        for entity in ("picture", "table/object", "table/hand"):
            assert {"time", "trial"} <= found[f"/{world}/{entity}"]["timelines"]
        for body in ("object", "background"):
            assert found[f"/{world}/table/{body}/centres"]["static"]
    texts = [value[0] for value in values(found, "/outcome", "TextDocument:text")]
    assert texts[0].startswith("**Trial 0: unseen 16**, quadrant 3")
    assert "- mirror: **not grasped** after 0.40 s" in texts[0]
    # The paths lie side by side, 70 mm apart.
    assert "sim to mirror: 70.0 mm" in texts[0]
    assert all("**success**" in text and "not grasped" not in text for text in texts[1:])


def test_curves_of_the_hands_distance_are_known(files, tmp_path):
    record_trials(CELL, files, "item", "background", tmp_path / "out.rrd")
    apart = np.array(values(read_recording(tmp_path / "out.rrd"), "/plots/apart", "Scalars:scalars"))[:10, 0]
    # Of the first trial: 0.3 m in five steps and in eight, 70 mm side by side; then the world that is done has no more to tell.
    steps = np.arange(6)
    known = 1e3 * np.hypot(0.07, 0.3 * (steps / 5 - steps / 8))
    np.testing.assert_allclose(apart[:6], known, rtol=1e-5)
    assert np.isnan(apart[6:]).all()


def test_all_paths_and_a_list_stand_beside_the_trials(files, tmp_path):
    record_trials(CELL, files, "item", "background", tmp_path / "out.rrd")
    found = read_recording(tmp_path / "out.rrd")
    paths = sorted(name for name in found if name.startswith("/paths/0"))
    assert len(paths) == 16
    assert "failure" in paths[0]
    assert all("success" in name for name in paths[2:])
    text = values(found, "/trials", "TextDocument:text")[0][0]
    assert "Successes of 8: sim 8, mirror 7" in text
    assert "| 0 | 0.0 | unseen 16 | 3 | success | not grasped |" in text
    # Eight steps of the slower world and the pause.
    assert "| 1 | 0.9 | fixed 0 | 1 | success | success |" in text


def test_one_world_alone_is_recorded_too(files, tmp_path):
    record_trials(CELL, files[:1], "item", "background", tmp_path / "out.rrd")
    found = read_recording(tmp_path / "out.rrd")
    assert "/plots/apart" not in found
    assert found["/sim/picture"]["rows"] == 48


def test_the_drawn_pads_are_as_far_apart_as_the_gripper_is_open():
    left, right, *_ = hand_lines(np.array([0.1, 0.2, 0.3]), 0.7, 0.08)
    gap = left.mean(axis=0) - right.mean(axis=0)
    assert np.linalg.norm(gap) == pytest.approx(0.08)
    np.testing.assert_allclose(0.5 * (left + right).mean(axis=0), [0.1, 0.2, 0.3])
    # They move across the tool's x axis.
    assert gap @ [np.cos(0.7), np.sin(0.7), 0.0] == pytest.approx(0.0, abs=1e-12)
