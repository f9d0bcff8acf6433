import runpy
import sys

import pytest

torch = pytest.importorskip("torch", reason="the extra models is not installed")

from repository import REPOSITORY
from torch.utils.data import DataLoader

from siren_ros.errors import InputError
from siren_ros.lab.training.packed.parquet_samples import PackedSamples, SamplesInMemory
from siren_ros.lab.training.torch_samples import SampleDataset, SampleStream, collated

TASKS = ("prediction", "detection", "risk")


def first_file(folder):
    return next(path for path in (folder / "train.parquet", folder / "val.parquet") if path.exists())


@pytest.mark.parametrize("task", TASKS)
def test_samples_become_tensors(packed, task):
    file = first_file(packed(task))
    samples, dataset = PackedSamples(file), SampleDataset(file)
    assert len(dataset) == len(samples) > 0
    for name, value in dataset[0].items():
        if samples.columns[name].is_text:
            assert value == samples[0][name]
        else:
            assert value.numpy().tolist() == samples[0][name].tolist()


def test_batches_stack_what_has_one_shape(packed):
    loader = DataLoader(SampleDataset(first_file(packed("detection"))), batch_size=2, collate_fn=collated)
    batch = next(iter(loader))
    assert batch["boxes"].shape[0] == len(batch["points"]) == len(batch["episode"])
    uneven = collated([{"points": torch.zeros(2, 5)}, {"points": torch.zeros(3, 5)}])
    assert [len(points) for points in uneven["points"]] == [2, 3]


@pytest.mark.filterwarnings("ignore:This DataLoader will create 2 worker processes")  # on one processor
@pytest.mark.parametrize("workers", [0, 2])
def test_ranks_and_workers_share_the_samples(packed, workers):
    file = first_file(packed("prediction"))

    def seen(rank, ranks, epoch):
        stream = SampleStream([file], seed=1, rank=rank, ranks=ranks)
        stream.set_epoch(epoch)
        return [
            (name, int(step), int(actor))
            for batch in DataLoader(stream, batch_size=16, num_workers=workers, collate_fn=collated)
            for name, step, actor in zip(batch["episode"], batch["step"], batch["actor_id"], strict=True)
        ]

    whole = seen(0, 1, 0)
    assert len(set(whole)) == len(whole) == len(PackedSamples(file))
    assert sorted(seen(0, 2, 0) + seen(1, 2, 0)) == sorted(whole)
    assert seen(0, 1, 0) == whole
    assert seen(0, 1, 1) != whole
    with pytest.raises(InputError, match="rank"):
        SampleStream([file], rank=2, ranks=2)
    samples = PackedSamples(file)
    memory = SampleDataset(SamplesInMemory(samples.columns, [samples[number] for number in range(4)]))
    assert len(memory) == 4
    assert torch.equal(memory[2]["future"], SampleDataset(samples)[2]["future"])


@pytest.mark.parametrize("task", TASKS)
def test_the_example_of_each_task_trains(packed, task, monkeypatch, capsys):
    path = REPOSITORY / "examples" / f"train_{task}.py"
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 60
    monkeypatch.setattr(sys, "argv", [str(path), str(packed(task)), "2"])
    torch.set_num_threads(1)
    runpy.run_path(str(path), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines[:2]] == ["epoch 1", "epoch 2"]
    assert all("a second" in line for line in lines[:2])
