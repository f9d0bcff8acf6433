"""What asking a model took: questions, tokens, time and money."""

from collections.abc import Collection

import numpy as np

from siren_ros.evaluation.risk.vlm.pipeline import VideoAnswer


def account(name: str, answers: Collection[VideoAnswer], prices: tuple[float, float] | None) -> list[str]:
    """Lines for a terminal.

    Args:
        name: The model.
        answers: To all videos.
        prices: Per million tokens of questions and of answers; without them no cost is printed.
    """
    replies = [reply for answer in answers for reply in answer.replies]
    unreadable = sum(prediction is None for answer in answers for prediction in answer.predictions)
    cached = sum(answer.cached for answer in answers)
    tokens = sum(reply.prompt_tokens for reply in replies), sum(reply.completion_tokens for reply in replies)
    line = f"{name}: {len(replies)} questions, {cached} of them answered before, {unreadable} answers unreadable"
    line += f"; {tokens[0]} tokens in, {tokens[1]} out"
    if prices is not None:
        line += f", cost {(tokens[0] * prices[0] + tokens[1] * prices[1]) / 1e6:.2f}"
    timed = [reply.seconds for reply in replies if reply.seconds > 0.0]
    if timed:
        middle, late = np.percentile(timed, (50.0, 95.0))
        line += f"; {middle:.2f} s for an answer (median), {late:.2f} s at the 95th percentile"
    return [line]
