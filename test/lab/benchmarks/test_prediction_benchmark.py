from siren_ros.lab.benchmarks.prediction import SAMPLES, Taken, main


def test_times_are_given_for_a_round_number_of_samples() -> None:
    cells = Taken(SAMPLES // 4, 2.0, 3.0).row("cv").split()
    assert cells == ["cv", str(SAMPLES // 4), "2.0", "3.0", "8.0", "12.0"]


def test_bags_are_predicted_until_there_were_enough_samples(tmp_path, write_bag, capsys) -> None:
    bag = write_bag(tmp_path / "S2_L2_seed0", duration_s=9.0)
    assert main([str(bag), "--models", "cv,idm", "--samples", "120"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    (_, there, *_), *models = rows
    rounds = -(-120 // int(there))
    assert rounds > 1
    assert [row[:2] for row in models] == [[name, str(rounds * int(there))] for name in ("cv", "idm")]
    assert all(len(row) == 6 for row in rows)
