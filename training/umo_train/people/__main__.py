"""Inspects the phones and accents found in people's recordings.

python -m umo_train.people check                      compare with voices whose phones and accents are known
python -m umo_train.people compare FOLDER             compare methods of finding phones, on people's recordings
python -m umo_train.people draw FOLDER -o PICTURE     draw recordings with their phones and accents
python -m umo_train.people hours CORPUS               print the hours of people's recordings in a corpus
"""

import argparse
from dataclasses import replace
from pathlib import Path

from umo_train.people import check


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    known = commands.add_parser("check", help="compare with voices whose phones and accents are known")
    known.add_argument("--voices", nargs="+", default=["flite-slt", "flite-rms", "espeak-en-gb-x-rp", "espeak-de+f2"])
    known.add_argument("--sentences", type=int, default=20)
    other = commands.add_parser("compare", help="compare other ways of finding people's phones with alignment")
    other.add_argument("folder", type=Path)
    other.add_argument("--language", default="en")
    other.add_argument("--count", type=int, default=16)
    look = commands.add_parser("draw", help="draw recordings with their phones and accents")
    look.add_argument("folder", type=Path)
    look.add_argument("--language", default="en")
    look.add_argument("--count", type=int, default=3)
    look.add_argument("-o", "--output", type=Path, required=True)
    share = commands.add_parser("hours", help="print the hours of people's recordings in a corpus")
    share.add_argument("corpus", type=Path)
    options = parser.parse_args()
    if options.command == "check":
        _check(options.voices, options.sentences)
    elif options.command == "compare":
        _compare(options.folder, options.language, options.count)
    elif options.command == "draw":
        _draw(options.folder, options.language, options.count, options.output)
    else:
        from umo_train.people.make import hours

        for kind, value in hours(options.corpus).items():
            print(f"{kind} {value:.2f} h")


def _check(names: list[str], count: int) -> None:
    _head("voice")
    heard = {}
    for name in names:
        language = "de" if name.startswith("espeak-de") else "en"
        truth = check.spoken(name, count)
        for method, find in check.methods(language).items():
            _row(name, method, check.agreement(truth, find))
        heard[name] = check.accents(truth)
    print("\n| voice | accents heard that are told | told that are heard | by chance |\n| --- | --- | --- | --- |")
    for name, got in heard.items():
        print(
            f"| {name} | {100 * got['precision']:.0f} % | {100 * got['recall']:.0f} % | {100 * got['chance']:.0f} % |"
        )


def _compare(folder: Path, language: str, count: int) -> None:
    from umo_train.data import recording
    from umo_train.people import align
    from umo_train.people.recordings import recordings
    from umo_train.speech.variation import leveled

    told = [one for one in recordings(folder) if one.text]
    chosen = told[:: max(len(told) // count, 1)][:count]
    aligned = [align.from_text(leveled(recording.samples(one.path), 24), one.text, language) for one in chosen]
    _head("people")
    for method, find in list(check.methods(language).items())[1:]:
        _row(folder.name, method, check.agreement([one for one in aligned if one], find))


def _head(first: str) -> None:
    print(f"| {first} | by | found | frames | shapes | starts off, ms: median | 95 % | p, b, m |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")


def _row(name: str, method: str, got: dict[str, float]) -> None:
    shares = [f"{100 * got.get(key, 0):.0f} %" for key in ("found", "frames", "shapes")]
    edges = [f"{got.get(key, 0):.0f}" for key in ("edge", "edge95")]
    lips = f"{100 * got.get('lips', 0):.0f} %"
    print(f"| {' | '.join([name, method, *shares, *edges, lips])} |", flush=True)


def _draw(folder: Path, language: str, count: int, output: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from umo_train.data import recording
    from umo_train.people import align
    from umo_train.people.accents import accented
    from umo_train.people.recordings import recordings
    from umo_train.speech.utterance import SAMPLE_RATE
    from umo_train.speech.variation import leveled

    found = recordings(folder)
    chosen = found[:: max(len(found) // count, 1)][:count]
    figure, axes = plt.subplots(len(chosen), 1, figsize=(18, 3.4 * len(chosen)), squeeze=False)
    for axis, one in zip(axes[:, 0], chosen, strict=True):
        samples = leveled(recording.samples(one.path), 24)
        spoken = align.phones(samples, one.text, language)
        axis.specgram(samples, NFFT=400, Fs=SAMPLE_RATE, noverlap=240, cmap="Greys", vmin=-120, vmax=-40)
        axis.set(ylim=(0, 7000), title=f"{one.name}: {one.text or 'text not known'}", ylabel="Hz")
        if spoken is None:
            axis.text(0, 6000, "no phones found")
            continue
        for phone in accented(replace(spoken, voice=one.reader)).phones:
            colour = "crimson" if phone.stress == 2 else "navy"
            axis.axvline(phone.start, color="tab:blue", linewidth=0.6)
            axis.text((phone.start + phone.end) / 2, 6300, phone.name, ha="center", fontsize=8, color=colour)
    figure.tight_layout()
    figure.savefig(output, dpi=70)


if __name__ == "__main__":
    main()
