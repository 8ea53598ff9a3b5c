"""Rows and tables hold the numbers of the stages' records, and nothing else."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from gsbridge.errors import InputError
from gsbridge.files import write_json
from gsbridge.images import write_image
from gsbridge.report.pages.tables import write_tables
from gsbridge.report.tables.paper import PAPER_RENDERING
from gsbridge.report.tables.rendering import scene_lines
from gsbridge.report.tables.rendering_rows import COLUMNS, differences, write_rendering_rows
from gsbridge.report.tables.rows import read_rows
from gsbridge.report.tables.stages import read_records, stages_table
from gsbridge.report.tables.timing import write_timing_rows

SCENES = {
    "banana": {"kind": "object", "origin": "mirror"},
    "plate": {"kind": "background", "origin": "mirror"},
    "banana_photos": {"kind": "object", "origin": "real"},
}


def _record(
    root: Path, scene: str, binding: str, psnr: float, *, seed: int = 0, surface: str = "visual", **more: object
) -> Path:
    """A record as the splats stage writes it; comparison runs go where they belong."""
    run = f"splats/{binding}" if seed == 0 and surface == "visual" else f"comparison/{surface}-{binding}-seed{seed}"
    path = root / "results" / "scenes" / scene / run / "splats.json"
    iou = None if SCENES[scene]["kind"] == "background" else 0.98
    figures = {"views": 5, "psnr": psnr, "ssim": 0.9, "lpips": None, "alpha_iou": iou}
    metrics = {
        "train": {"masked": {**figures, "psnr": psnr + 2}, "full": {**figures, "psnr": psnr + 4}},
        "held_out": {"masked": figures, "full": {**figures, "psnr": psnr + 1}},
    }
    record = {"status": "pass", "reasons": [], "binding": binding, "surface": surface, "seed": seed, "splats": 900}
    write_json(path, {**record, "metrics": metrics, **more})
    return path


@pytest.fixture
def records(tmp_path: Path) -> list[Path]:
    found = []
    for seed, soft, games in ((0, 31.0, 30.0), (1, 32.5, 30.5), (2, 31.5, 31.5)):
        found.append(_record(tmp_path, "banana", "soft", soft, seed=seed))
        found.append(_record(tmp_path, "banana", "games", games, seed=seed))
    found.append(_record(tmp_path, "banana", "refined", 31.75))
    found.append(_record(tmp_path, "banana", "soft", 28.0, surface="hull"))
    found.append(_record(tmp_path, "banana", "games", 25.0, surface="hull"))
    found.append(_record(tmp_path, "plate", "soft", 27.0))
    found.append(_record(tmp_path, "plate", "games", 26.9))
    found.append(_record(tmp_path, "banana_photos", "soft", 24.0, status="degraded", reasons=["14 of 16 <images> & no scale"]))
    return found


def test_rows_have_the_agreed_columns_and_the_papers_values(records: list[Path], tmp_path: Path) -> None:
    write_rendering_rows(records, tmp_path / "rendering.csv", scenes=SCENES)
    with (tmp_path / "rendering.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    agreed = "scene kind binding split region views psnr ssim lpips alpha_iou splats seed"
    assert list(rows[0])[:16] == [*agreed.split(), "paper_psnr", "paper_ssim", "paper_lpips", "status"]
    assert len(rows) == len(records) * 4
    wanted = {"binding": "soft", "seed": "1", "split": "train", "region": "full"}
    soft = next(row for row in rows if row | wanted == row)
    assert (soft["psnr"], soft["paper_psnr"], soft["paper_ssim"], soft["paper_lpips"]) == ("36.5000", "35.46", "0.989", "0.026")
    assert all(row["lpips"] == "" and "weights" in row["lpips_reason"] for row in rows)
    assert all(row["paper_psnr"] == "" for row in rows if row["origin"] == "real" or row["binding"] == "refined")
    assert list(dict.fromkeys(row["scene"] for row in rows)) == ["banana", "plate", "banana_photos"]


def test_same_records_give_the_same_bytes_in_any_order(records: list[Path], tmp_path: Path) -> None:
    write_rendering_rows(records, tmp_path / "a.csv", scenes=SCENES)
    write_rendering_rows(records[::-1], tmp_path / "b.csv", scenes=SCENES)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_differences_pair_equal_seeds_only(records: list[Path], tmp_path: Path) -> None:
    write_rendering_rows(records, tmp_path / "rendering.csv", scenes=SCENES)
    rows = read_rows(tmp_path / "rendering.csv", COLUMNS)
    fixed = {"split": "held_out", "region": "masked", "surface": "visual"}
    assert differences(rows, "soft", "games", **fixed)["banana"] == pytest.approx({"0": 1.0, "1": 2.0, "2": 0.0})
    assert differences(rows, "refined", "soft", **fixed)["banana"] == pytest.approx({"0": 0.75})
    line = scene_lines(rows, split="held_out", region="masked")[0]
    assert line.gain == pytest.approx(1.0)
    assert line.gain_range == pytest.approx((0.0, 2.0))
    assert line.paper_gain == pytest.approx(8.93)
    assert scene_lines(rows, split="held_out", region="masked", surface="hull")[0].gain == pytest.approx(3.0)


def test_what_an_early_stage_degraded_stays_degraded(records: list[Path], tmp_path: Path) -> None:
    align = tmp_path / "results/scenes/banana/align/align.json"
    write_json(align, {"status": "degraded", "reasons": ["the scale is unknown"]})
    write_rendering_rows(records, tmp_path / "rendering.csv", scenes=SCENES, records=[align])
    rows = read_rows(tmp_path / "rendering.csv", COLUMNS)
    assert {(row["scene"], row["status"]) for row in rows} == {
        ("banana", "degraded"),
        ("plate", "pass"),
        ("banana_photos", "degraded"),
    }
    assert all("the scale is unknown" in row["reasons"] for row in rows if row["scene"] == "banana")


def test_the_films_ceiling_stands_beside_the_score(records: list[Path], tmp_path: Path) -> None:
    ceilings = {"ceiling_db": {"16": 40.0, "64": 46.0}, "ceiling_masked_db": {"16": 37.0, "64": 43.5}}
    write_json(tmp_path / "film.json", {**ceilings, "frames": [{"spp": 16}, {"spp": 64}, {"spp": 16}]})
    write_rendering_rows(records, tmp_path / "rendering.csv", scenes=SCENES, films={"banana": tmp_path / "film.json"})
    rows = read_rows(tmp_path / "rendering.csv", COLUMNS)
    found = {(row["scene"], row["split"], row["region"]): row["ceiling_db"] for row in rows}
    assert [found["banana", "held_out", region] for region in ("masked", "full")] == ["43.5000", "46.0000"]
    assert [found["banana", "train", region] for region in ("masked", "full")] == ["37.0000", "40.0000"]
    assert found["plate", "held_out", "masked"] == ""
    line = scene_lines(rows, split="held_out", region="masked")[0]
    assert line.ceiling == 43.5


def test_damaged_and_unknown_records_are_refused(records: list[Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not configured"):
        write_rendering_rows(records, tmp_path / "rendering.csv", scenes={"banana": SCENES["banana"]})
    records[0].write_text(json.dumps({"binding": "soft"}))
    with pytest.raises(InputError, match="damaged"):
        write_rendering_rows(records, tmp_path / "rendering.csv", scenes=SCENES)
    assert not (tmp_path / "rendering.csv").exists()


def test_the_papers_table_agrees_with_its_own_slip() -> None:
    assert len(PAPER_RENDERING) == 14
    assert PAPER_RENDERING["plate", "soft"] == PAPER_RENDERING["tablecloth", "games"]
    gains = [PAPER_RENDERING[scene, "soft"].psnr - value.psnr for (scene, b), value in PAPER_RENDERING.items() if b == "games"]
    # The issue quotes the paper's mean gain as +2.4 dB.
    assert np.mean(gains) == pytest.approx(2.42, abs=0.005)


def test_timing_rows_come_from_both_layouts_of_benchmark_files(tmp_path: Path) -> None:
    line = {"s": 12.346, "cpu_time": 20.0, "max_rss": 512.04, "h:m:s": "0:00:12"}
    first = tmp_path / "benchmarks" / "train_splats" / "banana" / "soft.jsonl"
    second = tmp_path / "results" / "scenes" / "banana" / "benchmarks" / "reconstruct.jsonl"
    for path in (first, second):
        path.parent.mkdir(parents=True)
    first.write_text(json.dumps(line) + "\n" + json.dumps({**line, "s": 14.346, "max_rss": 600.0}) + "\n")
    second.write_text(json.dumps({**line, "cpu_time": "NA", "max_rss": None}) + "\n")
    write_timing_rows([first, second], tmp_path / "timing.csv")
    assert (tmp_path / "timing.csv").read_text().splitlines() == [
        "rule,item,wall_s,cpu_s,max_rss_mb",
        "reconstruct,banana,12.35,,",
        "train_splats,banana/soft,13.35,20.00,600.0",
    ]
    # Half a line of a job that is writing, or was killed, spoils no table.
    first.write_text('{"s": 1')
    write_timing_rows([first, second], tmp_path / "timing.csv")
    assert (tmp_path / "timing.csv").read_text().splitlines()[1:] == ["reconstruct,banana,12.35,,"]


def test_tables_folder_is_one_page_and_three_formats(records: list[Path], tmp_path: Path) -> None:
    rows = tmp_path / "rows"
    write_rendering_rows(records, rows / "rendering.csv", scenes=SCENES)
    timing = ["rule,item,wall_s,cpu_s,max_rss_mb", "film,a,60.00,60.00,100.0", "film,b,30.00,29.00,90.0", "sfm,a,9.00,,"]
    (rows / "timing.csv").write_text("\n".join(timing) + "\n")
    write_image(tmp_path / "rendering_comparison_real.png", np.full((8, 8, 3), 0.5, np.float32))
    out = tmp_path / "tables"
    write_tables([rows / "rendering.csv", rows / "timing.csv"], [tmp_path / "rendering_comparison_real.png"], out, preset="toy")
    names = {f"{name}.{suffix}" for name in ("rendering", "timing") for suffix in ("csv", "md", "tex")}
    assert {path.name for path in out.iterdir()} == names | {"index.html"}
    page = (out / "index.html").read_text()
    assert not re.search(r"(src|href)=\"(?!data:|#)", page), "the page must not load anything"
    assert "14 of 16 &lt;images&gt; &amp; no scale" in page
    assert page.index("Mirrored scenes</h2>") < page.index("Real captures</h2>") < page.index("data:image/jpeg")
    assert "repeats its" in page
    assert "On 1 mirrored object, soft binding shows held-out photos 1.00 dB better than GaMeS" in page
    markdown = (out / "rendering.md").read_text()
    assert "| banana | 30.67 | **31.67** | 31.75 |" in markdown or "| banana | 30.67 | 31.67 | **31.75** |" in markdown
    latex = (out / "rendering.tex").read_text()
    assert latex.count(r"\begin{table}") == latex.count(r"\end{table}") == 6
    assert "banana_photos" not in latex.replace(r"banana\_photos", "")
    assert "| film | 2 | 90.0 | 89.0 | 100 | a |" in (out / "timing.md").read_text()


def test_stage_records_fill_the_page(tmp_path: Path) -> None:
    scene = tmp_path / "results" / "scenes" / "banana_photos"
    write_json(scene / "capture" / "keyframes.json", {"status": "pass", "reasons": [], "frames": [{}] * 16})
    reasons = {"status": "degraded", "reasons": ["14 of 16 images registered"]}
    write_json(scene / "sfm" / "sfm.json", {**reasons, "registered": 14, "total": 16, "reprojection_px": 0.666})
    record = {"status": "degraded", "reasons": ["no board"], "scale": 2.0, "scale_se": 0.01, "scale_source": "unknown"}
    write_json(scene / "align" / "align.json", {**record, "residual_mm": 0.5})
    paths = [scene / name for name in ("capture/keyframes.json", "sfm/sfm.json", "align/align.json")]
    table = stages_table(read_records(paths))
    assert table.rows == (("banana_photos", "16", "14 of 16", "0.67", "unknown", "0.500", "0.50", "–", "degraded"),)
    out = tmp_path / "results" / "tables"
    write_tables([], [], out, records=paths, scene_pages=[scene / "report.html"])
    page = (out / "index.html").read_text()
    assert '<a href="../scenes/banana_photos/report.html">banana_photos</a>' in page
    assert "sfm: 14 of 16 images registered" in page
    assert "align: no board" in page
