"""The plan, and its interpretation by the pipeline."""

from pathlib import Path

import pytest
import sentencepiece
import torch
import yaml
from safetensors import safe_open

import made_run
from umo_train import export, model_config, pipeline
from umo_train.convert.layout import shapes
from umo_train.data.corpus import SpeechPlan
from umo_train.frames import root
from umo_train.frames import steps as frame_steps
from umo_train.frames.interp import VectorPlan
from umo_train.frames.tokenizers import plan_of
from umo_train.interp.train import InterpPlan
from umo_train.lm.train import StagePlan
from umo_train.skeleton import PARTS


def test_smoke_lies_over_the_plan() -> None:
    run = pipeline.Run.read(made_run.SMALL, Path("w"), smoke=True)
    assert run.plan["name"] == "umo-smoke" and run.plan["lm"]["d_model"] == 32
    # Common keys missing from smoke are kept; voices and stages are replaced as a whole.
    assert run.plan["lm"]["experts"] == 4 and run.plan["tokenizers"]["lower"] == {"layers": 4, "steps": 20}
    assert set(run.plan["speech"]["voices"]) == {"flite-slt", "flite-kal"}
    assert run.corpus == Path("w/corpus") and run.folder == Path("w/run")


def test_a_plan_lies_over_its_base() -> None:
    again, base = (
        pipeline.Run.read(made_run.SMALL.parent / name, Path("w")).plan for name in ("frames_again.yaml", "frames.yaml")
    )
    assert "base" not in again and again["parts"] == base["parts"] and again["lm"] == base["lm"]
    assert [stage["name"] for stage in again["stages"]] == ["again", "rounded_again"]
    assert again["audio"] == base["audio"] | {"listener": base["audio"]["listener"] | {"steps": 0}}


def test_a_base_may_have_a_base() -> None:
    configs = made_run.SMALL.parent
    again, third, settle = (
        pipeline.Run.read(configs / f"frames_{name}.yaml", Path("w")).plan for name in ("again", "third", "settle")
    )
    assert "base" not in third and third["parts"] == again["parts"] and third["start_language_model"]
    assert third["motion"] == {"accents": "units", "seeds": 10_000_000}
    assert settle["depth"] == again["depth"] and [stage["name"] for stage in settle["stages"]] == ["settle"]


def test_a_plan_has_the_steps_of_its_layout() -> None:
    run, frames = (
        pipeline.Run.read(made_run.SMALL.parent / name, Path("w")) for name in (made_run.SMALL.name, "frames.yaml")
    )
    assert {*pipeline._steps(run), *pipeline._steps(frames)} == set(pipeline.STEPS)
    assert pipeline._steps(run)["export"] is pipeline.step_export
    assert pipeline._steps(frames)["export"] is frame_steps.step_export
    with pytest.raises(ValueError, match="no step `report`"):
        pipeline.run(run, ("report",))
    run.plan["layout"] = "words"
    with pytest.raises(ValueError, match="no layout `words`"):
        pipeline.run(run)


def test_accents_are_heard_after_the_step_audio(tmp_path: Path) -> None:
    run = pipeline.Run.read(made_run.SMALL.parent / "frames_again.yaml", tmp_path)
    with pytest.raises(ValueError, match="after the step `audio`"):
        pipeline._heard_accents(run)
    (tmp_path / "run/audio_tokens").mkdir(parents=True)
    heard = pipeline._heard_accents(run)
    assert heard is not None and (heard.first, heard.delay, heard.rate) == (512, 14, 50)
    run.plan["motion"]["accents"] = "loudness"
    with pytest.raises(ValueError, match="loudness"):
        pipeline._heard_accents(run)
    assert pipeline._heard_accents(pipeline.Run.read(made_run.SMALL, tmp_path)) is None


@pytest.mark.parametrize("smoke", [False, True])
def test_plans_hold_what_stages_read(smoke: bool) -> None:
    run = pipeline.Run.read(made_run.SMALL, Path("w"), smoke=smoke)
    SpeechPlan(**run.plan["speech"])
    InterpPlan(**run.plan["interp_training"])
    for name in (*PARTS, "root"):
        assert pipeline._tokenizer_plan(run, name).steps > 0
    stages = [StagePlan(**stage) for stage in run.plan["stages"]]
    # As in the paper: dense and without the balancing loss first, then sparse with it.
    first, *rest = [(s.dense, s.balance) for s in stages]
    assert first == (True, 0.0) and rest == [(False, 0.01)] * len(rest) and len(rest) >= 2
    # A keyframe has a whole number of audio tokens, and a window fits the interpolation network.
    window = run.plan["window"]
    assert window["keyframe_stride"] * 50 % 30 == 0
    assert window["keyframe_stride"] * (window["max_target"] + window["prefix"]) <= run.plan["interp"]["max_frames"]


@pytest.mark.parametrize("smoke", [False, True])
def test_plans_of_layout_frames_hold_what_stages_read(smoke: bool) -> None:
    run = pipeline.Run.read(made_run.SMALL.with_name("frames.yaml"), Path("w"), smoke=smoke)
    SpeechPlan(**run.plan["speech"])
    VectorPlan(**run.plan["interp_training"])
    assert frame_steps.root_plan(run).width >= root.PASSED
    order = frame_steps.parts_of(run)
    assert [part.name for part in order if not part.moves] == ["intent"] and len(frame_steps.moving(run)) == 8
    if not smoke:
        # Including the intent, 31 codes per keyframe, as the plan says.
        assert all(part.codes == 256 for part in frame_steps.moving(run))
        assert sum(part.levels for part in frame_steps.moving(run)) == 30
    for entry in run.plan["parts"]:
        assert plan_of(run.plan["tokenizers"], entry, 3, 0).steps > 0
    stages = [frame_steps.stage_plan(run, stage) for stage in run.plan["stages"]]
    assert [(s.dense, s.balance) for s in stages] == [(True, 0.0), *[(False, 0.01)] * 4][: len(stages)]
    assert len(stages) == (2 if smoke else 5)
    window, ahead = run.plan["window"], run.plan["audio"]["ahead"]
    assert 0 < ahead <= window["prefix"]
    assert window["keyframe_stride"] * (window["max_target"] + window["prefix"]) <= run.plan["interp"]["max_frames"]


def test_the_text_model_is_the_plans(tmp_path: Path) -> None:
    run = pipeline.Run.read(made_run.SMALL, tmp_path)
    pieces = sentencepiece.SentencePieceProcessor(model_proto=run.text_model())
    assert pieces.get_piece_size() > model_config.TEXT_END
    (tmp_path / "plans").mkdir()
    (tmp_path / "plans" / "mine.yaml").write_text(yaml.safe_dump(run.plan | {"text_model": "my.model"}))
    (tmp_path / "plans" / "my.model").write_bytes(b"mine")
    assert pipeline.Run.read(tmp_path / "plans" / "mine.yaml", tmp_path / "work").text_model() == b"mine"


def test_the_config_describes_every_tensor(tmp_path: Path) -> None:
    """Using the shapes that converters check their files against."""
    run = made_run.make(tmp_path)
    pipeline.step_export(run)
    with safe_open(run.folder / "umo-smoke.safetensors", "pt") as file:
        found = {name: tuple(file.get_slice(name).get_shape()) for name in file.keys()}
    del found["text.tokenizer"]
    assert found == shapes(pipeline.model_file_config(run))


def test_sharpened_logits_are_drawn_more_closely() -> None:
    vocab = {"face": {"first": 2, "codes": 3}}
    language = {"lm_head.weight": torch.ones(8, 4)}
    export.sharpen(language, vocab, {"face": 2.5})
    assert language["lm_head.weight"].mean(1).tolist() == [1, 1, 2.5, 2.5, 2.5, 1, 1, 1]
    with pytest.raises(ValueError, match="tie_word_embeddings"):
        export.sharpen({}, vocab, {"face": 2.0})


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    run = made_run.make(tmp_path)
    (run.folder / "interp.pt").unlink()
    with pytest.raises(FileNotFoundError, match=r"interp\.pt is missing"):
        pipeline.step_export(run)
