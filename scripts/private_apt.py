"""Fetches Debian packages with apt and unpacks them into a folder, without changing the system.

apt runs with a sources list, package lists and a cache of its own, all under one folder; only the list of
installed packages is read from the system, so that exactly what the machine lacks is fetched. Root is not
needed. Standard library only: the set-up runs this before anything is installed.
"""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

APT_TIMEOUT_S = 540
_SYSTEM_SOURCES = Path("/etc/apt")


class AptUnavailable(RuntimeError):
    """Raised when packages cannot be had through apt here; the message says why."""


@dataclass(frozen=True, slots=True)
class Sources:
    """The distribution's own package sources.

    Attributes:
        codename: Release name, such as "bookworm".
        text: The same sources in apt's one-line form, with the backports suite added.
    """

    codename: str
    text: str


def _stanza_lines(stanza: dict[str, str], codename: str) -> list[str]:
    """Return one-line entries for a stanza of a .sources file that serves this release, else nothing."""
    suites, parts = stanza.get("suites", "").split(), stanza.get("components", "").split()
    wrong = codename not in suites or "main" not in parts or stanza.get("enabled", "yes").lower() == "no"
    if wrong or "deb" not in stanza.get("types", "").split():
        return []
    signed = stanza.get("signed-by", "")
    # A key written into the stanza itself has no one-line form; apt's trusted keyrings serve then.
    option = f"[signed-by={signed}] " if signed.startswith("/") else ""
    wanted = dict.fromkeys([*suites, f"{codename}-backports"])
    return [f"deb {option}{uri} {suite} main" for uri in stanza.get("uris", "").split() for suite in wanted]


def _stanzas(text: str) -> list[dict[str, str]]:
    """Return the stanzas of a deb822 file as dictionaries with lower-case keys."""
    found: list[dict[str, str]] = []
    for block in re.split(r"\n\s*\n", text):
        stanza: dict[str, str] = {}
        key = ""
        for line in block.splitlines():
            if line.startswith("#"):
                continue
            if line[:1].isspace() and key:
                stanza[key] += " " + line.strip()
            elif ":" in line:
                name, value = line.split(":", 1)
                key = name.strip().lower()
                stanza[key] = value.strip()
        found.append(stanza)
    return found


def _one_line_entries(text: str, codename: str) -> list[str]:
    """Return the `deb` lines of a sources.list that serve this release, each with its backports twin."""
    found: list[str] = []
    for line in text.splitlines():
        match = re.match(r"deb\s+(\[[^]]*\]\s+)?(\S+)\s+(\S+)\s+(.*)", line.strip())
        if match is None or "main" not in match[4].split("#")[0].split():
            continue
        options, uri, suite = match[1] or "", match[2], match[3]
        if suite == codename or suite.startswith(f"{codename}-"):
            found.append(f"deb {options}{uri} {suite} main")
        if suite == codename:
            found.append(f"deb {options}{uri} {codename}-backports main")
    return found


def read_sources(folder: Path = _SYSTEM_SOURCES) -> Sources:
    """Return the distribution's sources of this machine.

    Raises:
        AptUnavailable: when this is no Debian-like system or its sources cannot be read.
    """
    if not (shutil.which("apt-get") and shutil.which("dpkg-deb")):
        raise AptUnavailable("this system has no apt-get and dpkg-deb")
    codename = platform.freedesktop_os_release().get("VERSION_CODENAME", "")
    if not codename:
        raise AptUnavailable("the system does not name its release (VERSION_CODENAME)")
    lines: list[str] = []
    for path in sorted([folder / "sources.list", *folder.glob("sources.list.d/*")]):
        if path.suffix == ".list" and path.is_file():
            lines += _one_line_entries(path.read_text(encoding="utf-8"), codename)
        elif path.suffix == ".sources" and path.is_file():
            for stanza in _stanzas(path.read_text(encoding="utf-8")):
                lines += _stanza_lines(stanza, codename)
    if not lines:
        raise AptUnavailable(f"no package source for the release {codename!r} stands under {folder}")
    return Sources(codename, "\n".join(dict.fromkeys(lines)) + "\n")


class PrivateApt:
    """apt with its state under `folder`."""

    def __init__(self, folder: Path) -> None:
        """Write the private configuration.

        Raises:
            AptUnavailable: as `read_sources` does.
        """
        self.sources = read_sources()
        self.folder = folder
        for name in ("lists/partial", "lists/auxfiles", "cache/archives/partial", "preferences", "log"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / "sources.list").write_text(self.sources.text, encoding="utf-8")
        self._configuration = folder / "apt.conf"
        self._configuration.write_text(_configuration(folder), encoding="utf-8")

    def _run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = ["-c", str(self._configuration), *arguments]
        program = "apt-cache" if arguments[0] == "policy" else "apt-get"
        try:
            return subprocess.run(
                [program, *command], capture_output=True, text=True, timeout=APT_TIMEOUT_S, check=False,
                stdin=subprocess.DEVNULL,
            )  # fmt: skip
        except subprocess.TimeoutExpired as error:
            raise AptUnavailable(f"{program} gave no answer within {APT_TIMEOUT_S} s") from error

    def refresh(self) -> None:
        """Fetches the package lists, once; a source without a backports suite is no obstacle."""
        if any(self.folder.glob("lists/*_Packages*")):
            return
        done = self._run("update")
        if not any(self.folder.glob("lists/*_Packages*")):
            raise AptUnavailable(f"apt-get update brought no package lists: {_last_words(done.stderr)}")

    def candidate(self, package: str, suite: str | None = None) -> str | None:
        """Return the version that apt would fetch, or None when no source has the package."""
        shown = self._run("policy", *(["-t", suite] if suite else []), package).stdout
        match = re.search(r"Candidate:\s*(\S+)", shown)
        return match[1] if match and match[1] != "(none)" else None

    def fetch(self, packages: tuple[str, ...], suite: str | None = None) -> tuple[Path, ...]:
        """Downloads packages and those of their dependencies that this machine lacks.

        Args:
            packages: Package names.
            suite: Suite to prefer, such as "bookworm-backports".

        Raises:
            AptUnavailable: when apt cannot put the set together or the network fails.
        """
        archives = self.folder / "cache" / "archives"
        for old in archives.glob("*.deb"):
            old.unlink()
        options = ["--download-only", "--no-install-recommends", "--reinstall", "--yes"]
        done = self._run("install", *options, *(["-t", suite] if suite else []), *packages)
        fetched = tuple(sorted(archives.glob("*.deb")))
        if done.returncode != 0 or not fetched:
            raise AptUnavailable(f"apt could not fetch {', '.join(packages)}: {_last_words(done.stderr)}")
        return fetched

    def close(self) -> None:
        """Remove the private state."""
        shutil.rmtree(self.folder, ignore_errors=True)


def unpack(packages: tuple[Path, ...], into: Path) -> None:
    """Unpack package files into a folder; none of their install scripts run."""
    into.mkdir(parents=True, exist_ok=True)
    for package in packages:
        subprocess.run(["dpkg-deb", "-x", str(package), str(into)], check=True, stdin=subprocess.DEVNULL)


def _configuration(folder: Path) -> str:
    """Return the apt configuration that keeps every write under `folder`.

    It is read after the system's own, so proxies and certificates set there stay in force.
    """
    return f"""\
Dir::State::lists "{folder}/lists";
Dir::Cache "{folder}/cache";
Dir::Cache::archives "archives/";
Dir::Etc::sourcelist "{folder}/sources.list";
Dir::Etc::sourceparts "/dev/null";
Dir::Etc::preferences "/dev/null";
Dir::Etc::preferencesparts "{folder}/preferences";
Dir::Log "{folder}/log";
Acquire::Languages "none";
Acquire::Retries "2";
// No lock: nothing of the system is written. No user switch: the folder may be one that only its owner reads.
Debug::NoLocking "true";
APT::Sandbox::User "";
#clear APT::Update::Post-Invoke;
#clear APT::Update::Post-Invoke-Success;
#clear DPkg::Post-Invoke;
"""


def _last_words(text: str) -> str:
    """Return the errors of an apt run, or its last line."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith(("E:", "W: Failed"))]
    return " ".join(errors[:2] or lines[-1:]) or "no reason given"
