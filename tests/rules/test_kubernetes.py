"""The first stages through snakemake's Kubernetes executor and S3-compatible storage, as `profiles/kubernetes` says.

There is no cluster: a server on this machine answers the few requests that the executor makes, and runs each pod's command as a
process in an empty folder. This tests the profile and how sources, keys and files reach a job, but not Kubernetes itself.
"""

import base64
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
import yaml

from tests.rules.test_storage import BUCKET, FILMS, PREFIX, ROOT, storage

__all__ = ["storage"]

PACKAGES = os.environ.get("GSBRIDGE_KUBERNETES", "")
"""Folder of the executor's packages where they are not installed."""
KEYS = {"SNAKEMAKE_STORAGE_S3_ACCESS_KEY": "ali.baba", "SNAKEMAKE_STORAGE_S3_SECRET_KEY": "open.sesame"}
PLUGIN = "snakemake_executor_plugin_kubernetes"


class Cluster(ThreadingHTTPServer):
    """Answers as the API of a cluster does to the executor; pods are processes of this machine."""

    def __init__(self, folder: Path) -> None:
        super().__init__(("127.0.0.1", 0), Requests)
        self.folder = folder
        self.secrets: dict[str, dict] = {}
        self.jobs: dict[str, dict] = {}
        self.processes: dict[str, subprocess.Popen] = {}

    def submit(self, job: dict) -> None:
        name = job["metadata"]["name"]
        (container,) = job["spec"]["template"]["spec"]["containers"]
        references = {entry["name"]: entry["valueFrom"]["secretKeyRef"] for entry in container["env"]}
        values = {name: self.secrets[each["name"]]["data"][each["key"]] for name, each in references.items()}
        # The image has Python with gsbridge and the storage plugin, and a home folder, but nothing else of this environment.
        image = {"PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin", "PYTHONPATH": str(ROOT), "HOME": str(self.folder)}
        image["AWS_DEFAULT_REGION"] = "us-east-1"
        (self.folder / name).mkdir()
        self.jobs[name] = job
        self.processes[name] = subprocess.Popen(
            [*container["command"], *container["args"]],
            cwd=self.folder / name,
            env={**image, **{name: base64.b64decode(value).decode() for name, value in values.items()}},
            stdout=(self.folder / f"{name}.log").open("w"),
            stderr=subprocess.STDOUT,
        )

    def status(self, name: str) -> dict:
        code = self.processes[name].poll()
        return {"active": 1} if code is None else {"failed": 1} if code else {"succeeded": 1}


class Requests(BaseHTTPRequestHandler):
    server: Cluster

    def answer(self, content: dict) -> None:
        data = json.dumps(content).encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        if self.path.endswith("/secrets"):
            self.server.secrets[body["metadata"]["name"]] = body
        else:
            self.server.submit(body)
        self.answer(body)

    def do_GET(self) -> None:
        if "/pods" in self.path:
            self.answer({"kind": "PodList", "items": []})
        else:
            name = self.path.split("/")[-2]
            self.answer({"kind": "Job", "metadata": {"name": name}, "status": self.server.status(name)})

    def do_DELETE(self) -> None:
        self.answer({"kind": "Status", "status": "Success"})

    def log_message(self, *told: object) -> None:
        pass


@pytest.fixture
def cluster(tmp_path):
    """The cluster, and the environment in which the executor finds it."""
    if importlib.util.find_spec(PLUGIN) is None and not (Path(PACKAGES) / PLUGIN).is_dir():
        pytest.skip("needs the Kubernetes executor: the extra 'kubernetes', or GSBRIDGE_KUBERNETES")
    (tmp_path / "pods").mkdir()
    server = Cluster(tmp_path / "pods")
    threading.Thread(target=server.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{server.server_address[1]}"
    access = {
        "apiVersion": "v1",
        "kind": "Config",
        "current-context": "here",
        "contexts": [{"name": "here", "context": {"cluster": "here", "user": "nobody"}}],
        "clusters": [{"name": "here", "cluster": {"server": address}}],
        "users": [{"name": "nobody", "user": {}}],
    }
    (tmp_path / "access.yaml").write_text(yaml.safe_dump(access))
    paths = [path for path in (str(ROOT), PACKAGES) if path]
    environment = {**os.environ, **KEYS, "PYTHONPATH": ":".join(paths), "KUBECONFIG": str(tmp_path / "access.yaml")}
    yield server, {**environment, "AWS_DEFAULT_REGION": "us-east-1"}
    server.shutdown()
    for process in server.processes.values():
        process.kill()
        process.wait()


@pytest.fixture
def project(tmp_path):
    """The project as a clone has it, below the folder in which snakemake works: it sends no source that lies elsewhere."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file() and name.split("/")[0] not in ("docs", "tests"):
            (tmp_path / "project" / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, tmp_path / "project" / name)
    return tmp_path / "project"


def test_pods_make_the_first_stages_in_the_bucket(cluster, storage, project):
    server, environment = cluster
    client, address = storage
    target = "results/scenes/small_cube/capture/keyframes.json"
    call = [sys.executable, "-m", "snakemake"]
    call += ["--workflow-profile", str(project / "profiles/kubernetes"), "--default-storage-prefix", f"s3://{BUCKET}/{PREFIX}"]
    call += ["--storage-s3-endpoint-url", address, "--config", FILMS, "--seconds-between-status-checks", "2", "--", target]
    process = subprocess.run(call, cwd=project, env=environment, capture_output=True, text=True, timeout=900, check=False)
    logs = "".join(path.read_text() for path in server.folder.glob("*.log"))
    assert process.returncode == 0, process.stderr[-4000:] + logs[-4000:]
    names = {item["Key"].removeprefix(f"{PREFIX}/") for item in client.list_objects_v2(Bucket=BUCKET)["Contents"]}
    assert target in names
    # There were two jobs, film and keyframes, and their results do not lie on the machine that started the run.
    assert len(server.jobs) == 2
    assert not (project / "results/scenes").exists()
    (container, *_) = next(iter(server.jobs.values()))["spec"]["template"]["spec"]["containers"]
    assert container["resources"]["requests"]["memory"] == "2500M"
    told = json.dumps(server.jobs)
    assert not [value for value in KEYS.values() if value in told or base64.b64encode(value.encode()).decode() in told]
