"""Where the results of a folder are: in the folder itself, or in its subfolder `results`."""

from __future__ import annotations

import json
from pathlib import Path


def folder_of_results(folder: Path) -> Path:
    """`folder` if it holds results or has no subfolder `results`, else that subfolder.

    The same rule as FolderOfResults of benchmarks/records/result_file.cc, by which `b4mrl report`
    reads: a copy of a folder of results into another one lies inside it under the name `results`,
    and its files must not count twice.
    """
    inside = folder / "results"
    if not inside.is_dir():
        return folder
    return folder if any(map(_is_result, folder.glob("*.json"))) else inside


def _is_result(path: Path) -> bool:
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    has_entries = isinstance(entries, dict) and "curve" in entries
    return has_entries and isinstance(entries.get("benchmarks"), list)
