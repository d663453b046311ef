"""The table of scripts/test/protocols, from files that `report.py` wrote: table.py FILE…

Prints one row for each protocol and program; exit code 1 if a case failed or a file is empty.
"""

import sys
from collections import Counter

from report import DIFFERS, FAILED, NOTED, OK


def row(protocol: str, program: str, cases: list[tuple[str, str, str]]) -> str:
    verdicts = Counter(verdict for _, verdict, _ in cases)
    reasons = Counter((verdict, finding) for _, verdict, finding in cases if verdict in (DIFFERS, NOTED))
    notes = [f"{count}{' ok' * (verdict == NOTED)}: {reason}" for (verdict, reason), count in reasons.items()]
    notes += [f"**FAILED: {case}: {finding}**" for case, verdict, finding in cases if verdict == FAILED]
    return f"| {protocol} | {program} | {len(cases)} | {verdicts[OK] + verdicts[NOTED]} | {'; '.join(notes)} |"


def main(paths: list[str]) -> int:
    groups: dict[tuple[str, str], list[tuple[str, str, str]]] = {}
    empty = []
    for path in paths:
        with open(path) as file:
            lines = [line.rstrip("\n").split("\t") for line in file]
        if not lines:
            empty.append(path)
        for protocol, program, case, verdict, finding in lines:
            groups.setdefault((protocol, program), []).append((case, verdict, finding))
    print("| protocol | program | cases | ok | what differs, and why |\n|---|---|---|---|---|")
    for (protocol, program), cases in groups.items():
        print(row(protocol, program, cases))
    for path in empty:
        print(f"{path}: no cases", file=sys.stderr)
    verdicts = {verdict for cases in groups.values() for _, verdict, _ in cases}
    return int(FAILED in verdicts or bool(empty) or not paths)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
