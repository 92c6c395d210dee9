"""A real Spark standalone cluster on this machine: a master and workers, each a process, all on 127.0.0.1."""

from __future__ import annotations

import os
import re
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from logs.spark import LOCAL

PATIENCE_S = 300.0
_MASTER = re.compile(r"Starting Spark master at (spark://\S+)")
_REGISTERED = "Successfully registered with master"
_CLASSES = "org.apache.spark.deploy"


@contextmanager
def spark_cluster(folder: Path, workers: int = 2, worker_mb: int = 1024) -> Iterator[str]:
    """The address of a cluster's master while it runs; its logs and work are in `folder`."""
    with ExitStack() as processes:
        master = processes.enter_context(_process(folder, "master", f"{_CLASSES}.master.Master", "--port", "0"))
        address = _wait_for(master, _MASTER)
        options = ("--cores", "1", "--memory", f"{worker_mb}m", "--work-dir", str(folder / "work"), address)
        logs = [
            processes.enter_context(_process(folder, f"worker-{number}", f"{_CLASSES}.worker.Worker", *options))
            for number in range(workers)
        ]
        for log in logs:
            _wait_for(log, re.compile(f"({_REGISTERED})"))
        yield address


@contextmanager
def _process(folder: Path, name: str, *command: str) -> Iterator[Path]:
    """One process of the cluster, without the shell scripts that would leave it behind; yields its log."""
    import pyspark

    home = Path(pyspark.__file__).parent
    log = folder / f"{name}.log"
    environment = os.environ | {"SPARK_HOME": str(home), "SPARK_LOCAL_IP": LOCAL, "SPARK_DAEMON_MEMORY": "256m"}
    arguments = [str(home / "bin" / "spark-class"), *command, "--host", LOCAL, "--webui-port", "0"]
    with log.open("wb") as output:
        process = subprocess.Popen(arguments, env=environment, stdout=output, stderr=subprocess.STDOUT)
    try:
        yield log
    finally:
        process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _wait_for(log: Path, wanted: re.Pattern[str]) -> str:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        if (found := wanted.search(log.read_text(encoding="utf-8", errors="replace"))) is not None:
            return found[1]
        time.sleep(0.1)
    raise TimeoutError(f"{log.name}: no {wanted.pattern!r}; {log.read_text(errors='replace')[-2000:]}")
