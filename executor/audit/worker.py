"""Worker process that audits episodes: `python -m executor.audit.worker`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from executor.audit.episodes import audit_episode
from executor.data.store import EpisodeStore
from executor.system.files import plain
from executor.system.workers import serve


def _handle(request: dict[str, Any]) -> dict[str, Any]:
    episode = EpisodeStore(Path(request["store"])).episode(request["episode"])
    answer: dict[str, Any] = plain(audit_episode(episode, with_replay=request["with_replay"]).to_json())
    return answer


if __name__ == "__main__":
    serve(_handle)
