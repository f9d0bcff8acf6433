"""A model of risk of one's own: `./env --with models python examples/train_risk.py DIR [EPOCHS]`.

DIR is what `siren pack risk SET… --out DIR` wrote. The network sees how the picture changes.
"""

import sys
import time
from pathlib import Path

import torch
from torch import nn
from torch.utils.data import DataLoader, WeightedRandomSampler

from siren_ros.training.torch_samples import SampleDataset, collated


class RiskModel(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        sizes = [(2, 8), (8, 16), (16, 24), (24, 32)]
        layers = [part for size in sizes for part in (nn.Conv2d(*size, 3, 2, 1), nn.BatchNorm2d(size[1]), nn.ReLU())]
        self.pictures = nn.Sequential(*layers, nn.AdaptiveAvgPool2d((2, 5)), nn.Flatten(), nn.Linear(320, 32))
        self.time = nn.Sequential(nn.Conv1d(32, 32, 5, padding=2), nn.ReLU(), nn.Conv1d(32, 3, 5, padding=2))

    def forward(self, frames: torch.Tensor) -> torch.Tensor:
        grey = (frames.float() - 128.0) / 64.0
        change = torch.diff(grey, dim=1, prepend=grey[:, :1])
        seen = self.pictures(torch.stack((grey, change), dim=2).flatten(0, 1)).unflatten(0, grey.shape[:2])
        return self.time(seen.transpose(1, 2)).amax(dim=2)  # the most severe moment decides


def main() -> None:
    folder, epochs = Path(sys.argv[1]), int((*sys.argv, 5)[2])
    torch.manual_seed(0)
    train, model = SampleDataset(folder / "train.parquet"), RiskModel()
    labels = torch.tensor([int(train[number]["label"]) for number in range(len(train))])
    rare = 1.0 / torch.bincount(labels, minlength=3).clamp(min=1)[labels]  # each class as often as the others
    sampler = WeightedRandomSampler(rare.tolist(), len(train), generator=torch.Generator().manual_seed(0))
    optimizer = torch.optim.AdamW(model.parameters(), lr=1e-3)
    for epoch in range(epochs):
        start, total = time.monotonic(), 0.0
        for batch in DataLoader(train, batch_size=4, sampler=sampler, collate_fn=collated):
            loss = nn.functional.cross_entropy(model(batch["frames"]), batch["label"])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            total += float(loss.detach()) * len(batch["label"])
        speed = len(train) / (time.monotonic() - start)
        print(f"epoch {epoch + 1}: loss {total / len(train):.3f}, {speed:.1f} films a second")
    if (judged := folder / "val.parquet").exists():
        with torch.no_grad():
            loader = DataLoader(SampleDataset(judged), batch_size=4, collate_fn=collated)
            right = [model.eval()(batch["frames"]).argmax(dim=1) == batch["label"] for batch in loader]
            print(f"val: {torch.cat(right).float().mean():.0%} of {len(loader.dataset)} films")


if __name__ == "__main__":
    main()
