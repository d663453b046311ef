"""`python -m umo_train.metrics`: `eval`, `mismatch`, `conditions`, `languages`, `conversation`, `agreement`, `sheet`,
`autoencoder` and `table`."""

import argparse
import json
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from umo_train.metrics import acted, agreement, fgd, frame_agreement, item, program, report, table
from umo_train.metrics.measure import Subject, measure

if TYPE_CHECKING:
    from umo_train.mouth.run import Mouth

DEFAULT_MODEL = Path(__file__).parents[3] / "models/umo-people/model.safetensors"


def _held_out(args: argparse.Namespace) -> list[item.Item]:
    out = item.load_folder(args.items) if args.items else []
    for split in args.split if args.corpus else ():
        out += item.from_corpus(args.corpus, split, args.most, args.varied, args.seeds)
    return out


def _eval(args: argparse.Namespace) -> None:
    subject = Subject(program.find(args.umo), args.model, args.exact, args.seed, tuple(shlex.split(args.more)))
    held_out = _held_out(args)
    real = item.recordings(args.speech)[: args.recordings] if args.speech else []
    if args.corpus:
        # Recordings of readers in the training data do not count.
        known = item.readers(args.corpus)
        kept = [one for one in real if one.voice not in known]
        if len(kept) < len(real):
            print(f"left out, as their readers are in the training data: {len(real) - len(kept)} recordings")
        real = kept
    captured = item.captured(args.captured) if args.captured else []
    if not held_out and not real:
        raise SystemExit("nothing to evaluate: give --items, --corpus or --speech")
    encoder = fgd.AutoEncoder.load(args.autoencoder) if held_out else None
    found = measure(subject, held_out, real, encoder, args.seeds, captured)
    if args.corpus:
        found.groups["actions"] = acted.measure(subject.umo, args.model, args.corpus, args.acted, more=subject.more)
    about = {
        "items": len(held_out),
        "recordings": len(real),
        "minutes": round(sum(i.seconds for i in (*held_out, *real)) / 60, 1),
        "seed": args.seed,
        "with": args.more or "nothing else",
        "auto-encoder": args.autoencoder.name,
    }
    for bar in report.write(args.output, subject, found, about, args.sheets):
        value = "not measured" if bar.value is None else f"{bar.value:.3f}"
        print(
            f"{'met   ' if bar.met else 'missed'}  {bar.name}: {value} ({'>=' if bar.at_least else '<='} {bar.bar:g})"
        )
    print(args.output / "report.html")


# Settings of the program that `mismatch` judges by default.
SETTINGS = (
    "default=",
    "no horizon=--horizon 0",
    "no layers=--layers 0",
    "excited=--prompt excited",
    "retimed=--retime",
)


def _mismatch(args: argparse.Namespace) -> None:
    from umo_train.metrics import mismatch, mismatch_report, takes

    options = mismatch.Options(args.seconds, args.edge, args.folds, args.steps, args.seed, args.jobs)
    work = args.work or args.output / "motion"
    about = asdict(options) | {"minutes_per_speaker": args.minutes}
    rows: dict[str, dict] = {}

    def judge(name: str, of: list[takes.Take], more: Sequence[takes.Take] = ()) -> None:
        rows[name] = mismatch_report.finds(mismatch.tried(of, options, more), args.seed)
        print(name, *(f"{view} {share.text(1, 100)} %" for view, share in rows[name]["network"].items()), flush=True)
        if all(take.motion is not None for take in of):
            rows[name]["protocols"] = mismatch_report.protocols(of, args.seed)
        # After each subject, as a run takes minutes.
        mismatch_report.write(args.output, rows, about)

    def subjects() -> Iterator[tuple[str, list[takes.Take], list[takes.Take]]]:
        for name, folder in (_named(text) for text in args.motion):
            yield name, takes.from_folder(Path(folder))[: args.most], []
        if not args.speech and not args.voices:
            return
        least = 2 * (args.seconds + args.edge) if args.joined is None else args.joined
        speech = takes.joined(args.speech, args.voices, least, args.minutes)[: args.most]
        umo = program.find(args.umo)
        for name, more in (_named(text) for text in args.setting or SETTINGS):
            drawn = []
            for draw in range(args.draws):
                folder = work / (f"{name} {draw}" if draw else name)
                drawn.append(takes.animated(umo, args.model, speech, shlex.split(more), args.seed + draw, folder))
            yield name, drawn[0], [take for of in drawn[1:] for take in of]
        if args.mouth:
            from umo_train.mouth.run import Mouth

            yield "live mouth", takes.of_mouth(Mouth.read(args.model or DEFAULT_MODEL), speech), []

    for name, of, more in subjects():
        if args.controls and not rows:
            judge("control: motion of other speech", mismatch.swapped(of, args.seed))
            judge("control: motion that also follows loudness", mismatch.puppets(of))
        judge(name, of, more)
    if not rows:
        raise SystemExit("nothing to judge: give --motion, --speech or --voices")
    print(mismatch_report.text(rows), end="")


def _named(text: str) -> tuple[str, str]:
    name, _, value = text.partition("=")
    return name, value


def _agreement(args: argparse.Namespace) -> None:
    umo = program.find(args.umo)
    items = [one for split in args.split for one in item.from_corpus(args.corpus, split, args.most, 0, 0)]
    is_frames = agreement.config_of(umo, args.exact).get("layout") == "frames"
    trace = frame_agreement.trace if is_frames else agreement.trace
    traced = [chunk for one in items for chunk in trace(umo, one, args.exact, args.chunks, args.seed)]
    for model in args.models:
        if is_frames:
            shares, error = frame_agreement.compare(umo, traced, args.exact, model)
            of_logits = f", error of logits {100 * error:.1f} %"
        else:
            shares, of_logits = agreement.agreement(umo, traced, args.exact, model), ""
        said = " ".join(f"{part} {100 * share:.1f} %" for part, share in shares.items())
        print(f"{model}: {model.stat().st_size / 1e6:.1f} MB, {len(traced)} chunks, {said}{of_logits}")


def _conditions(args: argparse.Namespace) -> None:
    from umo_train.metrics import conditions
    from umo_train.speech.conditions import takes

    subject, mouth = _two_paths(args)
    speech = conditions.small_recordings() if args.small else [i for one in args.speech for i in item.recordings(one)]
    made = takes(speech, conditions.SMALL_S if args.small else args.seconds, args.most)
    print(f"{len(made)} takes of {len({take.voice for take in made})} speakers, {conditions.seconds(made):.0f} s")
    found = conditions.measure(subject, mouth, made, conditions.chosen(args.small))
    _write(args.output / "conditions", conditions.markdown(found), {"takes": [take.name for take in made]} | found)
    if args.small:
        _fail(conditions.failures(subject, mouth, found))


def _languages(args: argparse.Namespace) -> None:
    from umo_train.metrics import conditions, languages

    subject, mouth = _two_paths(args)
    spoken = languages.spoken(1, languages.SPEAKERS[:1]) if args.small else languages.spoken()
    paths = {
        "`umo animate`": lambda samples: conditions.delayed(subject, samples, args.seed).opening,
        "live mouth": lambda samples: conditions.live(mouth, samples).opening,
    }
    found = languages.measure(spoken, paths)
    _write(args.output / "languages", languages.markdown(found), found)
    if args.small:
        _fail(languages.failures(found))


def _conversation(args: argparse.Namespace) -> None:
    from umo_train.metrics import conversation

    umo, readers, found = program.find(args.umo), [conversation.sentences(one) for one in args.voices], []
    for seed in range(args.seed, args.seed + args.draws):
        laid_out = conversation.lay_out(readers, args.seconds, seed)
        folder = args.output / f"conversation-{seed}"
        motions = conversation.animate(umo, laid_out.voices, folder, seed)
        still = conversation.animate(umo, laid_out.voices, folder / "still", seed, "--layers", "nods=0")
        one = conversation.measure(laid_out, motions, still)
        leaky, share = conversation.leaky(laid_out.voices), f"{100 * conversation.LEAK:.0f} %"
        for name, voices, is_stereo in (
            ("mouth open while only the other speaks", None, False),
            (f"the same, two channels with {share} crosstalk", leaky, True),
            (f"the same, two recordings with {share} crosstalk", leaky, False),
        ):
            made = motions
            if voices is not None:
                made = conversation.animate(umo, voices, folder / f"leaky-{is_stereo}", seed, is_stereo=is_stereo)
            one[name] = conversation.open_mouths(laid_out, made)
        found.append(one)
    _write(args.output / "conversation", conversation.markdown(found), {"conversations": found})


def _two_paths(args: argparse.Namespace) -> tuple[Subject, "Mouth"]:
    """The program, and the live mouth of the same model as it runs here: the engine's is held to it by a test."""
    from umo_train.mouth.run import Mouth

    return Subject(program.find(args.umo), args.model, seed=args.seed), Mouth.read(args.model)


def _write(path: Path, text: str, numbers: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.with_suffix(".md").write_text(text)
    path.with_suffix(".json").write_text(json.dumps(numbers, indent=1) + "\n")
    print(text, end="")


def _fail(failures: list[str]) -> None:
    if failures:
        raise SystemExit("\n".join(failures))


def _sheet(args: argparse.Namespace) -> None:
    from umo_train.metrics import sheet

    subject = Subject(program.find(args.umo), args.model, seed=args.seed)
    speech = item.recording(args.speech)
    sheet.save(speech, subject.animate(speech, prompt=args.prompt), args.output, args.title or "", args.dpi)


def _autoencoder(args: argparse.Namespace) -> None:
    motions = [i.motion for i in item.from_corpus(args.corpus, "train", args.most, 0, 0)]
    fgd.train_autoencoder(motions, args.seed, args.epochs).save(args.output)


def _table(args: argparse.Namespace) -> None:
    named = dict(pair.split("=", 1) if "=" in pair else (Path(pair).parent.name, pair) for pair in args.reports)
    text = table.table(named)
    if args.output:
        args.output.write_text(text)
    else:
        print(text, end="")


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="umo-train metrics", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, run, about: str) -> argparse.ArgumentParser:
        made = commands.add_parser(name, help=about, description=about)
        made.set_defaults(run=run)
        made.add_argument("--seed", type=int, default=0)
        return made

    one = command("eval", _eval, "Evaluate a model with every measure: report.json and report.html")
    one.add_argument("--model", type=Path, help="model file (default: the embedded one)")
    one.add_argument("--exact", type=Path, help="the same model with float weights, for comparison with int8")
    one.add_argument("--umo", type=Path, help="the program (default: on PATH or target/release/umo)")
    one.add_argument("--items", type=Path, help="folder of evaluation items (.npz)")
    one.add_argument(
        "--corpus", type=Path, help="folder of the corpus, for its held-out splits with the performer's motion"
    )
    one.add_argument("--split", nargs="+", default=["test_sentence", "test_voice"])
    one.add_argument("--most", type=int, default=1000, help="maximum number of items per split")
    one.add_argument("--varied", type=int, default=3, help="items per split to animate with every prompt")
    one.add_argument("--seeds", type=int, default=2, help="takes of each prompt")
    one.add_argument("--acted", type=int, default=4, help="takes of each action, if the corpus has any")
    one.add_argument("--speech", type=Path, help="folder of real recordings")
    one.add_argument("--recordings", type=int, help="maximum number of recordings")
    one.add_argument("--captured", type=Path, help="folder of speech whose mouth was captured (.npz with `opening`)")
    one.add_argument("--autoencoder", type=Path, default=fgd.JUDGE, help="motion auto-encoder (default: the package's)")
    one.add_argument(
        "--more", default="", help="other arguments of `umo animate` and `umo text`, in one word: --more='--horizon 0'"
    )
    one.add_argument("--sheets", type=int, default=3, help="contact sheets in the page")
    one.add_argument("-o", "--output", type=Path, required=True, help="folder to write to")

    def speech_as_it_is(name: str, run, about: str) -> argparse.ArgumentParser:
        one = command(name, run, about)
        one.add_argument("--model", type=Path, default=DEFAULT_MODEL, help="model file (default: the repository's)")
        one.add_argument("--umo", type=Path, help="the program (default: on PATH or target/release/umo)")
        one.add_argument("--small", action="store_true", help="a minute of synthesised speech, with checks")
        one.add_argument("-o", "--output", type=Path, required=True, help="folder to write to")
        return one

    one = speech_as_it_is(
        "conditions", _conditions, "Measure noise, voices, music, telephones, whispers, shouts, laughs: Markdown, JSON"
    )
    one.add_argument("--speech", type=Path, nargs="+", default=[], help="folders of real recordings")
    one.add_argument("--seconds", type=float, default=12, help="length of a take of a speaker's recordings")
    one.add_argument("--most", type=int, default=3, help="maximum number of takes per speaker")
    speech_as_it_is("languages", _languages, "Measure closures in eleven languages by synthesisers: Markdown and JSON")

    one = command(
        "mismatch",
        _mismatch,
        "Find a motion's speech among other speech of its speaker with a judge network: mismatch.md and mismatch.json",
    )
    one.add_argument(
        "--speech",
        type=Path,
        nargs="+",
        default=[],
        help="folders of recordings to animate, a file's first word being its speaker",
    )
    one.add_argument(
        "--voices", type=Path, nargs="+", default=[], help="folders of recordings to animate, each of one speaker"
    )
    one.add_argument("--setting", action="append", help="NAME=ARGUMENTS of `umo animate` to judge (default: five)")
    one.add_argument("--mouth", action="store_true", help="also judge the live mouth")
    one.add_argument(
        "--motion",
        action="append",
        default=[],
        help="NAME=FOLDER of motion beside its sound, of BEAT2, or of landmarks",
    )
    one.add_argument("--model", type=Path, help="model file (default: the embedded one)")
    one.add_argument("--umo", type=Path, help="the program (default: on PATH or target/release/umo)")
    one.add_argument("--seconds", type=float, default=4.0, help="length of a window")
    one.add_argument("--edge", type=float, default=0.8, help="seconds at a file's ends that are left out")
    one.add_argument("--minutes", type=float, default=2.0, help="most speech of a speaker")
    one.add_argument(
        "--joined", type=float, help="join a speaker's clips to this many seconds (default: two windows and the edges)"
    )
    one.add_argument("--most", type=int, help="most takes of a subject")
    one.add_argument("--draws", type=int, default=1, help="motions of a recording, of as many seeds, for its words")
    one.add_argument("--folds", type=int, default=3)
    one.add_argument("--steps", type=int, default=100, help="steps of each training")
    one.add_argument("--jobs", type=int, default=2, help="processes")
    one.add_argument("--controls", action="store_true", help="also judge controls made from the first subject")
    one.add_argument(
        "--work", type=Path, help="folder that keeps motion for the next run (default: motion in the output)"
    )
    one.add_argument("-o", "--output", type=Path, required=True, help="folder to write to")

    one = command("conversation", _conversation, "Lay out two readers' turns, animate them, measure looks and nods")
    one.add_argument("--voices", type=Path, nargs=2, required=True, help="folders of recordings, each of one speaker")
    one.add_argument("--umo", type=Path, help="the program (default: on PATH or target/release/umo)")
    one.add_argument("--seconds", type=float, default=180, help="length of a conversation")
    one.add_argument("--draws", type=int, default=3, help="conversations")
    one.add_argument("-o", "--output", type=Path, required=True, help="folder to write to")

    one = command("agreement", _agreement, "Compare greedy codes of quantised models with the exact model's")
    one.add_argument("models", nargs="+", type=Path)
    one.add_argument("--exact", type=Path, required=True, help="the model that they were quantised from")
    one.add_argument("--umo", type=Path, help="the program (default: on PATH or target/release/umo)")
    one.add_argument("--corpus", type=Path, required=True)
    one.add_argument("--split", nargs="+", default=["test_voice", "test_sentence"])
    one.add_argument("--most", type=int, default=4, help="maximum number of items per split")
    one.add_argument("--chunks", type=int, default=10, help="chunks of each item")

    one = command("sheet", _sheet, "Draw one recording as a strip of poses and faces over its waveform")
    one.add_argument("speech", type=Path)
    one.add_argument("--model", type=Path)
    one.add_argument("--umo", type=Path)
    one.add_argument("--prompt")
    one.add_argument("--title")
    one.add_argument("--dpi", type=int, default=110)
    one.add_argument("-o", "--output", type=Path, required=True)

    one = command("autoencoder", _autoencoder, "Train the auto-encoder of FGD on the corpus' training split")
    one.add_argument("--corpus", type=Path, required=True)
    one.add_argument("--most", type=int, default=300, help="items to train on")
    one.add_argument("--epochs", type=int, default=20)
    one.add_argument("-o", "--output", type=Path, required=True)

    one = command("table", _table, "Combine reports into one Markdown table")
    one.add_argument("reports", nargs="+", help="NAME=report.json, or report.json named by its folder")
    one.add_argument("-o", "--output", type=Path)
    return parser


if __name__ == "__main__":
    arguments = _arguments().parse_args()
    arguments.run(arguments)
