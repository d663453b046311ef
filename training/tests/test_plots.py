"""Curves drawn from logs."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib import image

from umo_train import plots
from umo_train.__main__ import main
from umo_train.log import Log


def _run(folder: Path) -> Path:
    stage = Log(folder / "lm_stage2.csv", 0)
    tokenizer = Log(folder / "tokenizer_face.csv", 0)
    for step in range(400):
        values = {"loss_a2m": 5 * np.exp(-step / 100), "accuracy": 0.4}
        values |= {f"{kind}_layer{i}": 0.25 * (i + 1) for kind in ("top1", "used") for i in range(3)}
        stage.add(step, values | ({"held_out_loss": 3.0, "held_out_face": 0.5} if step % 100 == 99 else {}))
        tokenizer.add(step, {"error": 1 / (step + 1), "commitment": 0.0, "perplexity": 20.0, "unheard_of": 1.0})
    Log(folder / "lm_pretrain.csv", 0)
    return folder


def test_each_log_is_a_figure_and_experts_another(tmp_path: Path) -> None:
    written = plots.draw(_run(tmp_path), tmp_path / "plots")
    # A stage that has not started has none.
    assert [path.name for path in written] == ["lm_stage2.png", "tokenizer_face.png", "experts.png"]
    for path in written:
        picture = image.imread(path)[..., :3]
        assert picture.shape[1] > 600 and 0.001 < (picture.min(2) < 0.9).mean() < 0.9


def test_panels_hold_their_curves(tmp_path: Path) -> None:
    _run(tmp_path)

    def panels(name: str) -> dict[str, set[str]]:
        figure = plots._stage(name, plots.read(tmp_path / f"{name}.csv"))
        return {axis.get_title("left"): {text.get_text() for text in axis.get_legend().texts} for axis in figure.axes}

    assert panels("lm_stage2") == {
        "Cross-entropy": {"loss a2m", "held out loss"},
        "Accuracy": {"accuracy", "held out face"},
    }
    assert panels("tokenizer_face") == {
        "Codes in use (perplexity)": {"perplexity"},
        "Errors": {"error", "commitment"},
        "Other": {"unheard of"},
    }


def test_smoothing_keeps_lines_and_lessens_noise() -> None:
    line = np.linspace(0, 3, 300)
    np.testing.assert_allclose(plots._smoothed(line)[5:-5], line[5:-5])
    noise = np.random.default_rng(0).standard_normal(600)
    assert plots._smoothed(noise).std() < 0.4 and len(plots._smoothed(noise)) == 600


def test_the_program_draws_without_a_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _run(tmp_path / "run")
    main(["--work", str(tmp_path), "plots"])
    assert capsys.readouterr().out.splitlines()[-1] == str(tmp_path / "run" / "plots" / "experts.png")
    with pytest.raises(FileNotFoundError, match="no log"):
        plots.draw(tmp_path, tmp_path)


def test_wrong_steps_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--work", str(tmp_path), "--config", "x.yaml", "train"])
    assert "no such step: train" in capsys.readouterr().err
