"""Where the two probabilities are cut."""

import numpy as np

from siren_ros.training.risk.operating_point import classes_at, operating_point

LABELS = np.array([0] * 20 + [1] * 10 + [2] * 5)


def test_separable_classes_are_separated() -> None:
    random = np.random.default_rng(0)
    logits = np.stack((np.where(LABELS >= 1, 3.0, -1.0), np.where(LABELS == 2, -2.0, -6.0)), axis=1)
    logits = (logits + random.uniform(-0.5, 0.5, logits.shape)).astype(np.float32)
    near, hit = operating_point(logits, LABELS)
    assert -0.5 <= near <= 2.5
    assert -5.5 <= hit <= -2.5
    assert (classes_at(logits, (near, hit)) == LABELS).all()


def test_the_collision_question_comes_first() -> None:
    logits = np.array([[-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]], dtype=np.float32)
    assert classes_at(logits, (0.0, 0.0)).tolist() == [2, 1, 0]


def test_rare_answers_are_not_bought_with_many_false_ones() -> None:
    # The second question knows nothing: at the paper's balance any collision answer would be wrong 16 times of 17.
    random = np.random.default_rng(1)
    logits = np.stack((np.where(LABELS >= 1, 3.0, -1.0), random.normal(size=len(LABELS))), axis=1).astype(np.float32)
    near, hit = operating_point(logits, LABELS)
    assert np.mean(classes_at(logits, (near, hit)) == 2) < 0.2
