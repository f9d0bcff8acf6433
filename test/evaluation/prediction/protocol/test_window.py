import numpy as np

from siren_ros.evaluation.prediction.protocol.window import HistoryWindow, future_offsets, future_times_s


def test_the_future_is_5_s_every_200_ms() -> None:
    assert np.allclose(future_times_s(), np.arange(1, 26) * 0.2)
    assert len(future_offsets()) == 25


def test_the_history_is_3_s_every_200_ms_with_the_present() -> None:
    times = HistoryWindow().times_s
    assert np.allclose(times, np.arange(-15, 1) * 0.2)


def test_other_histories_are_possible() -> None:
    times = HistoryWindow(points=50, stride_frames=1).times_s
    assert np.allclose(times, np.arange(-49, 1) * 0.1)
