"""A trajectory predictor of one's own: `./env --with models python examples/train_prediction.py DIR [EPOCHS]`.

DIR is what `siren pack prediction BAG… --out DIR` wrote. The network sees all actors and lanes as tokens.
"""

import sys
import time
from pathlib import Path

import torch
from torch import nn
from torch.utils.data import DataLoader

from siren_ros.training.torch_samples import SampleDataset, SampleStream, collated


class Predictor(nn.Module):
    def __init__(self, width: int = 64) -> None:
        super().__init__()
        self.actors = nn.Sequential(nn.Linear(16 * 7 + 7, width), nn.ReLU(), nn.Linear(width, width))
        self.lanes = nn.Sequential(nn.Linear(20 + 6 + 5, width), nn.ReLU(), nn.Linear(width, width))
        self.mixed = nn.TransformerEncoderLayer(width, 4, 4 * width, dropout=0.0, batch_first=True)
        self.future = nn.Linear(width, 25 * 2)

    def forward(self, batch: dict) -> torch.Tensor:
        history = torch.cat((batch["history"] / 20.0, batch["observed"][..., None].float()), dim=-1).flatten(2)
        signal = nn.functional.one_hot(batch["lane_signal"].long(), 5).float()
        lanes = torch.cat((batch["lanes"].flatten(2) / 20.0, batch["lane_flags"].float(), signal), dim=-1)
        tokens = torch.cat((self.actors(torch.cat((history, batch["flags"].float()), dim=-1)), self.lanes(lanes)), 1)
        nobody = ~torch.cat((batch["flags"][..., 0], batch["lane_flags"][..., 0]), dim=1)
        change = self.future(self.mixed(tokens, src_key_padding_mask=nobody)[:, 0]).unflatten(1, (25, 2))
        at_constant_velocity = batch["history"][:, 0, -1, None, 4:] * 0.2 * torch.arange(1, 26)[None, :, None]
        return at_constant_velocity + 5.0 * change

    def ade_m(self, batch: dict) -> torch.Tensor:
        return (self(batch) - batch["future"]).norm(dim=-1).mean()


def main() -> None:
    folder, epochs = Path(sys.argv[1]), int((*sys.argv, 5)[2])
    torch.manual_seed(0)
    stream, model = SampleStream([folder / "train.parquet"]), Predictor()
    optimizer = torch.optim.AdamW(model.parameters(), lr=1e-3)
    for epoch in range(epochs):
        stream.set_epoch(epoch)
        start, total = time.monotonic(), 0.0
        for batch in DataLoader(stream, batch_size=64, collate_fn=collated):
            optimizer.zero_grad()
            (loss := model.ade_m(batch)).backward()
            optimizer.step()
            total += loss.item() * len(batch["future"])
        speed = len(stream) / (time.monotonic() - start)
        print(f"epoch {epoch + 1}: ADE {total / len(stream):.2f} m, {speed:.0f} samples a second")
    with torch.no_grad():
        errors = [model.ade_m(collated([sample])) for sample in SampleDataset(folder / "val.parquet")]
        print(f"val: ADE {torch.stack(errors).mean():.2f} m")


if __name__ == "__main__":
    main()
