"""Audio units: k-means of features, with mini-batches on any device."""

import torch
from torch import Tensor
from tqdm import tqdm


def nearest(rows: Tensor, centroids: Tensor) -> Tensor:
    """Index of each row's nearest centroid."""
    return (centroids.pow(2).sum(1) - 2 * rows @ centroids.T).argmin(1)


def kmeans(rows: Tensor, units: int, steps: int, seed: int, device: torch.device | None = None) -> Tensor:
    """`units` centroids of `[n, width]`: k-means++ on a sample, then Lloyd's steps; empty clusters restart at the rows
    farthest from their centroid. The steps run on `device` in parts: rows need not fit there."""
    generator = torch.Generator().manual_seed(seed)
    centroids = _plus_plus(rows[torch.randperm(len(rows), generator=generator)[: 40 * units]], units, generator)
    centroids = centroids.to(device or rows.device)
    norms = rows.pow(2).sum(1)
    for _ in tqdm(range(steps), "k-means"):
        sums, counts = torch.zeros_like(centroids), torch.zeros(units, device=centroids.device)
        farthest = []
        for part, norm in zip(rows.split(1 << 16), norms.split(1 << 16), strict=True):
            part, norm = part.to(centroids.device), norm.to(centroids.device)
            distances = centroids.pow(2).sum(1) - 2 * part @ centroids.T
            least, index = distances.min(1)
            sums.index_add_(0, index, part)
            counts += torch.bincount(index, minlength=units)
            worst = (least + norm).topk(2).indices
            farthest.append(part[worst])
        centroids = torch.where(counts[:, None] > 0, sums / counts.clamp(min=1)[:, None], centroids)
        empty = (counts == 0).nonzero()[:, 0]
        if len(empty):
            spare = torch.cat(farthest)
            picked = torch.randint(len(spare), (len(empty),), generator=generator)
            centroids[empty] = spare[picked.to(spare.device)]
    return centroids.to(rows.device)


def _plus_plus(rows: Tensor, units: int, generator: torch.Generator) -> Tensor:
    chosen = [rows[0]]
    distances = (rows - chosen[0]).pow(2).sum(1)
    for _ in range(units - 1):
        pick = torch.multinomial(distances / distances.sum(), 1, generator=generator)[0]
        chosen.append(rows[pick])
        distances = torch.minimum(distances, (rows - rows[pick]).pow(2).sum(1))
    return torch.stack(chosen)


def telling_edge(values: Tensor, wanted: Tensor, edges: int = 200) -> float:
    """The threshold on values `[n]` that best separates rows that are `wanted` `[n]`: being above it has the largest
    mutual information with them."""
    lowest, highest = float(values.min()), float(values.max())
    best_of, edge = -1.0, lowest
    for candidate in torch.linspace(lowest, highest, edges + 2)[1:-1]:
        above = values > candidate
        joint = torch.tensor([[(above & wanted).sum(), (above & ~wanted).sum()],
                              [(~above & wanted).sum(), (~above & ~wanted).sum()]]).double()  # fmt: skip
        joint = joint / joint.sum()
        apart = joint.sum(1, keepdim=True) * joint.sum(0, keepdim=True)
        told = float(torch.where(joint > 0, joint * (joint / apart).log(), 0.0).sum())
        if told > best_of:
            best_of, edge = told, float(candidate)
    return edge
