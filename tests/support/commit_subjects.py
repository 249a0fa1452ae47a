"""Commits whose subject is longer than 72 characters: `python -m tests.support.commit_subjects` names them, status 1.

Older commits than `SINCE` have longer ones and are left alone. Without git, outside a clone, and in a shallow clone
that ends before `SINCE`, nothing can be said, and the status is 0.
"""

import subprocess
from pathlib import Path

from tests.support.paths import ROOT

LONGEST = 72
SINCE = "04eed80b58deaf41f7cc51044c123d5702c65b5f"


def too_long(folder: Path = ROOT, since: str = SINCE) -> list[str]:
    """Return the subjects, newest first."""
    command = ["git", "-C", str(folder), "log", "--format=%s", f"{since}..HEAD"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return []
    return [subject for subject in done.stdout.splitlines() if len(subject) > LONGEST] if done.returncode == 0 else []


if __name__ == "__main__":
    found = too_long()
    for subject in found:
        print(f"{len(subject)} characters, at most {LONGEST}: {subject}")
    raise SystemExit(bool(found))
