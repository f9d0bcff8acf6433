"""A detector of one's own: `./env --with models python examples/train_detection.py DIR [EPOCHS]`.

DIR is what `siren pack detection BAG… --out DIR` wrote. The network finds centres of vehicles from above.
"""

import sys
import time
from pathlib import Path

import torch
from torch import nn
from torch.utils.data import DataLoader

from siren_ros.training.torch_samples import SampleStream, collated

HALF_M, CELLS = 51.2, 256


def cells_of(xy: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    cell = ((xy + HALF_M) / (2 * HALF_M / CELLS)).long()
    return cell, ((cell >= 0) & (cell < CELLS)).all(dim=1)


def picture_of(points: torch.Tensor) -> torch.Tensor:
    picture, (cell, inside) = torch.zeros(3, CELLS, CELLS), cells_of(points[:, :2])
    values = torch.stack((points[:, 2] + 2.0, points[:, 3], (points[:, 4] < 0.01).float()))[:, inside]
    places = (cell[inside, 1] * CELLS + cell[inside, 0]).expand(3, -1)
    return picture.flatten(1).scatter_reduce(1, places, values, "amax").unflatten(1, (CELLS, CELLS))


def heat_of(boxes: torch.Tensor) -> torch.Tensor:
    heat, (cell, inside) = torch.zeros(CELLS, CELLS), cells_of(boxes[boxes[:, 10] > 0, :2])  # with a LiDAR point
    heat[cell[inside, 1], cell[inside, 0]] = 1.0
    return nn.functional.max_pool2d(heat[None], 3, 1, 1)[0]


def main() -> None:
    folder, epochs = Path(sys.argv[1]), int((*sys.argv, 5)[2])
    torch.manual_seed(0)
    stream = SampleStream([folder / "train.parquet"])
    layers = [part for size in ((3, 16), (16, 16)) for part in (nn.Conv2d(*size, 5, padding=2), nn.ReLU())]
    model = nn.Sequential(*layers, nn.Conv2d(16, 1, 1))
    optimizer = torch.optim.AdamW(model.parameters(), lr=2e-3)
    loss_of = nn.BCEWithLogitsLoss(pos_weight=torch.tensor(100.0))  # centres are rare
    for epoch in range(epochs):
        stream.set_epoch(epoch)
        start, total = time.monotonic(), 0.0
        for batch in DataLoader(stream, batch_size=2, collate_fn=collated):
            heat = torch.stack([heat_of(boxes) for boxes in batch["boxes"]])
            answer = model(torch.stack([picture_of(points) for points in batch["points"]]))[:, 0]
            optimizer.zero_grad()
            (loss := loss_of(answer, heat)).backward()
            optimizer.step()
            total += loss.item() * len(heat)
        speed = len(stream) / (time.monotonic() - start)
        print(f"epoch {epoch + 1}: loss {total / len(stream):.3f}, {speed:.1f} frames a second")


if __name__ == "__main__":
    main()
