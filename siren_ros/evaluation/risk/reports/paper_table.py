"""The paper's table of the risk task ("Per-Class Risk Classification Results on SIREN-Bench")."""

from collections.abc import Mapping
from typing import Final

PAPER_SCORES: Final[Mapping[str, Mapping[str, float]]] = {
    name: dict(
        zip(
            (
                "accuracy",
                "precision_normal",
                "f1_normal",
                "precision_near_miss",
                "f1_near_miss",
                "precision_collision",
                "f1_collision",
            ),
            (value / 100.0 for value in row),
            strict=True,
        )
    )
    for name, row in {
        "Blaifa-InternVL3.5-8B": (47.62, 84.21, 57.14, 28.12, 40.45, 0.00, 0.00),
        "Gemma3-12B": (26.67, 90.00, 21.43, 23.75, 36.19, 0.00, 0.00),
        "LLaVA-Llama3-8B": (22.86, 0.00, 0.00, 23.08, 37.21, 0.00, 0.00),
        "MiniCPM-V-4.5-8B": (49.52, 85.96, 74.81, 0.00, 0.00, 6.25, 11.11),
        "Qwen3.5-9B": (70.48, 70.48, 82.68, 0.00, 0.00, 0.00, 0.00),
    }.items()
}
"""Score by model and name, as shares. The paper prints percentages of 105 videos."""

PAPER_BALANCE: Final = (74, 25, 6)
"""Normal, Near-Miss, Collision. The paper does not print it; no other balance of 105 videos gives all its numbers."""
