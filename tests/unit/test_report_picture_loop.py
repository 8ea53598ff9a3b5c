"""The table of the closed loop of pictures."""

import csv

from gsbridge.files import write_json
from gsbridge.report.figures.loop import PictureLoopFiles, write_picture_loop

HEADER = ("pose_set", "index", "quadrant", "success", "success_tolerant", "failure")
PLAN = (("default", "mirror", 8), ("default", "tint", 3), ("sees", "sim", 8), ("sees", "tint", 7))


def test_rows_and_page_tell_before_after_and_the_price(tmp_path):
    tables = []
    for k, (_, _, good) in enumerate(PLAN):
        with open(tmp_path / f"{k}.csv", "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(HEADER)
            for n in range(8):
                word = "true" if n < good else "false"
                writer.writerow(("fixed", n, 1, word, word, "" if n < good else "time_out"))
        tables.append(tmp_path / f"{k}.csv")
    trainings = [tmp_path / variant / "seed1" / "training.json" for variant in ("default", "sees")]
    for path, steps in zip(trainings, (5000, 7000), strict=True):
        write_json(path, {"steps": steps, "cpu_seconds": {"act": 60.0, "update": 120.0}})
    found = {"simulations": {"bank": 0, "case": 50}, "seconds": 60.0}
    for world, verdict, photos in (("mirror", "no_discrepancy", 144), ("tint", "named", 24)):
        write_json(tmp_path / f"{world}_photos.json", {"views": photos})
        write_json(tmp_path / f"{world}.json", {**found, "verdict": verdict, "sentence": f"Said of {world}."})
    files = PictureLoopFiles(
        {"task": "grasp", "object": "bear", "background": "foam_pad", "seed": 1},
        [{"variant": variant, "world": world} for variant, world, _ in PLAN],
        ["mirror", "tint"],
        tables,
        trainings,
        [tmp_path / f"{world}_photos.json" for world in ("mirror", "tint")],
        [tmp_path / f"{world}.json" for world in ("mirror", "tint")],
    )
    out = [tmp_path / name for name in ("rows.csv", "loop.md", "loop.png")]
    write_picture_loop(files, *out)
    rows = list(csv.DictReader(out[0].open()))
    assert [int(row["successes"]) for row in rows] == [8, 3, 8, 7]
    assert [int(row["training_steps"]) for row in rows] == [5000, 5000, 7000, 7000]
    page = out[1].read_text()
    for words in (
        "mirror: **no discrepancy**. Said of mirror.",
        "tint: **named**. Said of tint.",
        "144 photos on the first day; later 24 in tint",
        "sees: a training of 7000 steps, 3 minutes",
        "7/8",
    ):
        assert words in page, words
    assert "default: a training" not in page
    assert out[2].stat().st_size > 5000
