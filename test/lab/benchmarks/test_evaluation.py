from siren_ros.lab.benchmarks.evaluation import main


def test_it_prints_each_model_and_the_whole(tmp_path, write_bag, capsys) -> None:
    bag = write_bag(tmp_path / "S2_L2_seed0", duration_s=9.0)
    assert main([str(bag), "--population=all", "--samples=70", "--jobs=1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines[:3]] == ["read 1 bags", "cv", "idm"]
    assert lines[3].startswith("100 samples of 2 bags with cv, idm: ")


def test_bags_without_samples(tmp_path, write_bag, capsys) -> None:
    assert main([str(write_bag(tmp_path / "short", duration_s=1.0)), "--jobs=1"]) == 2
    assert "no samples" in capsys.readouterr().out
