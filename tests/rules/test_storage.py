"""The first stages with their results in S3-compatible storage, through snakemake's plugin and a server on this machine."""

import importlib.util
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NEEDED = ("moto", "flask_cors", "boto3", "snakemake_storage_plugin_s3")
BUCKET, PREFIX = "lab", "gsbridge"
FILMS = "films={frames: 8, width: 160, height: 120, spp: 4, held_out_spp: 4}"
KEYS = {"SNAKEMAKE_STORAGE_S3_ACCESS_KEY": "key", "SNAKEMAKE_STORAGE_S3_SECRET_KEY": "secret"}


@pytest.fixture
def storage(tmp_path):
    """Client of a server that holds one empty bucket in its memory, and the server's address."""
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        pytest.skip(f"needs {', '.join(missing)}: of requirements-test.lock")
    import boto3
    import botocore.exceptions

    said = tmp_path / "server"
    with said.open("w") as output:
        # With port 0 the server chooses a free one and prints it.
        server = subprocess.Popen([sys.executable, "-m", "moto.server", "-p", "0"], stdout=output, stderr=output)
    try:
        until = time.monotonic() + 120
        while "Running on " not in said.read_text():
            assert time.monotonic() < until, said.read_text()
            assert server.poll() is None, said.read_text()
            time.sleep(0.2)
        address = said.read_text().split("Running on ")[1].split()[0]
        client = boto3.client(
            "s3", endpoint_url=address, aws_access_key_id="key", aws_secret_access_key="secret", region_name="us-east-1"
        )
        while True:
            try:
                client.create_bucket(Bucket=BUCKET)
                break
            except botocore.exceptions.EndpointConnectionError:
                assert time.monotonic() < until
                time.sleep(0.2)
        yield client, address
    finally:
        server.terminate()
        server.wait(timeout=30)


def test_the_first_stages_lie_in_the_bucket_and_are_found_there(storage, tmp_path):
    client, address = storage
    target = "results/scenes/small_cube/capture/keyframes.json"
    call = [sys.executable, "-m", "snakemake", "--directory", str(tmp_path / "run"), "--cores", "1"]
    call += ["--workflow-profile", str(ROOT / "profiles/s3"), "--default-storage-prefix", f"s3://{BUCKET}/{PREFIX}"]
    call += ["--storage-s3-endpoint-url", address, "--config", FILMS]
    environment = {**os.environ, **KEYS, "AWS_DEFAULT_REGION": "us-east-1"}

    def run(*arguments):
        process = subprocess.run(
            [*call, *arguments, "--", target],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        assert process.returncode == 0, process.stdout[-3000:] + process.stderr[-3000:]
        return process.stdout + process.stderr

    run()
    listed = client.list_objects_v2(Bucket=BUCKET)["Contents"]
    names = {item["Key"].removeprefix(f"{PREFIX}/") for item in listed}
    assert target in names
    record = json.loads(client.get_object(Bucket=BUCKET, Key=f"{PREFIX}/{target}")["Body"].read())
    frames = [name for name in names if name.startswith("results/scenes/small_cube/capture/frames/") and name.endswith(".png")]
    assert len(frames) == len(record["frames"]) > 0
    # The results lie in the storage only: a machine with an empty folder and the same address has nothing left to do.
    assert not (tmp_path / "run/results/scenes").exists()
    call[call.index("--directory") + 1] = str(tmp_path / "elsewhere")
    assert "Nothing to be done" in run("--dry-run")
