"""Cases of a protocol as lines for `table.py`: protocol, program, case, verdict and finding, between tabs."""

import sys

# A noted case is ok, and the table says what was found.
OK, NOTED, DIFFERS, FAILED = "ok", "noted", "differs", "FAILED"


class Report:
    """Cases of one protocol, judged by one program."""

    def __init__(self, protocol: str, program: str) -> None:
        self.protocol, self.program = protocol, program

    def say(self, case: str, verdict: str, finding: str = "") -> None:
        print(self.protocol, self.program, case, verdict, finding, sep="\t")
        if verdict == FAILED:
            print(f"{self.protocol}, {self.program}: {case}: FAILED: {finding}", file=sys.stderr)

    def check(self, case: str, is_ok: bool, finding: object = "") -> None:
        self.say(case, OK if is_ok else FAILED, str(finding))

    def within(self, case: str, found: float, most: float, unit: str = "") -> None:
        """A case that is ok if an error is at most `most`."""
        self.check(case, bool(found <= most), f"{found:.4g}{unit}, at most {most:g}{unit}")
