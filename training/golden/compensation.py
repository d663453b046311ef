"""`cli/src/quantize/compensate.json`: codes that error-compensating rounding must choose, by the formulas of the paper
(Frantar et al. 2023, "GPTQ", algorithm 1) in PyTorch, in f64.

    python training/golden/compensation.py
"""

import json
from pathlib import Path

import torch

ROWS, INPUTS, GROUP, BLOCK, SAMPLES, DAMPING = 6, 24, 8, 10, 60, 0.01
PATH = Path(__file__).parents[2] / "cli/src/quantize/compensate.json"


def rounded(w: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
    return (w / step).round().clamp(-8, 7)


def algorithm_1(w: torch.Tensor, gram: torch.Tensor, steps: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """The factor of the inverse Hessian, and the codes; steps are given for every weight."""
    hessian = 2 * gram
    hessian = hessian + DAMPING * hessian.diagonal().mean() * torch.eye(INPUTS, dtype=torch.float64)
    inverse = torch.linalg.cholesky(torch.linalg.inv(hessian), upper=True)
    w, codes = w.clone(), torch.zeros_like(w)
    for i in range(0, INPUTS, BLOCK):
        end = min(i + BLOCK, INPUTS)
        errors = torch.zeros(ROWS, end - i, dtype=torch.float64)
        for j in range(i, end):
            codes[:, j] = rounded(w[:, j], steps[:, j])
            errors[:, j - i] = (w[:, j] - codes[:, j] * steps[:, j]) / inverse[j, j]
            w[:, j:end] -= errors[:, j - i, None] * inverse[None, j, j:end]
        w[:, end:] -= errors @ inverse[i:end, end:]
    # The paper's Hessian is twice the Gram matrix.
    return inverse * 2**0.5, codes


def main() -> None:
    random = torch.Generator().manual_seed(1)
    normal = lambda *shape: torch.randn(*shape, generator=random, dtype=torch.float64)  # noqa: E731
    # Correlated inputs of different sizes, one of them always 0.
    x = normal(SAMPLES, INPUTS // 3) @ normal(INPUTS // 3, INPUTS) + 0.3 * normal(SAMPLES, INPUTS)
    x *= torch.exp(0.5 * normal(INPUTS))
    x[:, 5] = 0
    gram = x.T @ x
    w = normal(ROWS, INPUTS).float().double()
    largest = w.reshape(ROWS, -1, GROUP).abs().amax(-1) / 7
    steps = largest.repeat_interleave(GROUP, 1)
    cases = []
    for order in None, gram.diagonal().argsort(descending=True, stable=True):
        turned = torch.arange(INPUTS) if order is None else order
        factor, codes = algorithm_1(w[:, turned], gram[turned][:, turned], steps[:, turned])
        back = codes[:, turned.argsort()]
        cases.append(
            {
                "order": None if order is None else order.tolist(),
                "factor": factor.flatten().tolist(),
                "codes": back.int().tolist(),
            }
        )
    data = {
        "inputs": INPUTS,
        "damping": DAMPING,
        "gram": gram.flatten().tolist(),
        "weights": w.tolist(),
        "steps": steps.tolist(),
        "cases": cases,
    }
    PATH.write_text(json.dumps(data) + "\n")


if __name__ == "__main__":
    main()
