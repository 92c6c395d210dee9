"""`make bench`: every benchmark in turn, or those named. Each prints its own figures."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

TOOLS = Path(__file__).parent


def main(wanted: list[str]) -> int:
    """Run `bench_*.py`; the exit status is the number of those that failed."""
    failed = 0
    for script in sorted(TOOLS.glob("bench_*.py")):
        name = script.stem.removeprefix("bench_")
        if wanted and name not in wanted:
            continue
        print(f"\n== {name} ==", flush=True)
        failed += subprocess.run([sys.executable, str(script)], check=False).returncode != 0
    return failed


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
