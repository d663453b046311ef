"""Autobahn's fuzzing client against a WebSocket server: websocket.py echo|serve URL FOLDER SUITE [all]

`echo` is a server that returns each message, `serve` is `umo serve`, which refuses them: it expects a hello. SUITE is
the folder where the suite is installed; it runs under Python 2.7 (PYTHON2). `all` adds limits (9) and compression (12,
13).
"""

import json
import os
import subprocess
import sys
from pathlib import Path

from report import DIFFERS, FAILED, NOTED, OK, Report

GROUPS = {
    1: "framing",
    2: "pings",
    3: "reserved bits",
    4: "opcodes",
    5: "fragments",
    6: "UTF-8",
    7: "close",
    9: "limits",
    10: "automatic fragments",
    12: "compression",
    13: "compression, parameters",
}
SLOW = ["9.*", "12.*", "13.*"]
NO_HELLO = ("this message is not understood", "the first message must be a hello")
# The suite's verdict on a close whose TCP connection it had to end. It waits half a second in some cases.
LATE = "FAILED BY CLIENT"
LIMIT = "messages over 64 KiB are refused (1009)"


def run(url: str, folder: Path, suite: str, excluded: list[str]) -> dict[str, dict]:
    """Results of the cases, by their numbers."""
    folder.mkdir(parents=True, exist_ok=True)
    spec = folder / "spec.json"
    server = {"agent": "umo", "url": url}
    spec.write_text(json.dumps({"outdir": str(folder), "servers": [server], "cases": ["*"], "exclude-cases": excluded}))
    python = os.environ.get("PYTHON2", "python2.7")
    # `addsitedir` also makes the suite's namespace packages known.
    start = f"import site; site.addsitedir({suite!r}); from autobahntestsuite.wstest import run; run()"
    command = [python, "-c", start, "-m", "fuzzingclient", "-s", str(spec)]
    with open(folder / "log", "w") as log:
        subprocess.run(command, check=True, stdout=log, stderr=log)
    return json.loads((folder / "index.json").read_text())["umo"]


def details(folder: Path, case: dict) -> dict:
    return json.loads((folder / case["reportfile"]).read_text())


def number(case: str) -> tuple[int, ...]:
    return tuple(map(int, case.split(".")))


def report_of(case: str, kind: str) -> Report:
    group = number(case)[0]
    return Report(f"WebSocket, {kind}: {group} {GROUPS[group]}", "Autobahn 25.10.1")


def judge_echo(case: str, result: dict, report: dict) -> tuple[str, str]:
    behavior, close = result["behavior"], result["behaviorClose"]
    if behavior == "UNIMPLEMENTED":
        return DIFFERS, "compression is not offered (unimplemented)"
    if behavior == "FAILED" and case.startswith("9.") and report["remoteCloseCode"] == 1009:
        return DIFFERS, LIMIT
    if behavior == "NON-STRICT" and close == "OK":
        return DIFFERS, "non-strict: invalid UTF-8 is found at the end of its frame, not at once"
    if behavior == "INFORMATIONAL":
        return NOTED, "informational"
    if (behavior, close) == ("OK", LATE):
        return NOTED, "after the close frames TCP stays open for 0.5 s, and the suite ends it"
    return (OK, "") if behavior == close == "OK" else (FAILED, f"{behavior}, close {close}: {report['result']}")


def judge_serve(case: str, result: dict, report: dict) -> tuple[str, str]:
    verdict, finding = judge_echo(case, result, report)
    if verdict != FAILED:
        return verdict, finding
    said = [entry[1] for entry in report["received"] if entry[0] == "message"]
    is_error = len(said) == 1 and said[0].startswith('{"type":"error","code":"bad_request"')
    if not is_error or not report["wasClean"]:
        return verdict, finding
    code, reason = report["remoteCloseCode"], report["remoteCloseReason"]
    if code == 4400 and reason.startswith(NO_HELLO):
        return DIFFERS, "needs an echo: 4400, since the first message is not a hello"
    if result["behaviorClose"] in ("OK", LATE) and code in report["expectedClose"]["closeCode"]:
        return DIFFERS, "an `error` message comes before the close frame, whose code is the expected one"
    return verdict, finding


JUDGES = {"echo": judge_echo, "serve": judge_serve}


def main(kind: str, url: str, folder: str, suite: str, *more: str) -> None:
    place = Path(folder).resolve()
    results = run(url, place, suite, [] if "all" in more else SLOW)
    for case in sorted(results, key=number):
        verdict, finding = JUDGES[kind](case, results[case], details(place, results[case]))
        report_of(case, kind).say(case, verdict, finding)


if __name__ == "__main__":
    main(*sys.argv[1:])
