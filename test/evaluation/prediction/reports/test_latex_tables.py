"""LaTeX tables, line by line; ``reported_scores`` says what their numbers follow from."""

from made_scores import reported_scores

from siren_ros.evaluation.prediction.reports.latex_tables import latex_tables
from siren_ros.evaluation.prediction.reports.score_table import score_table

OWN = r"""
% RMSE (m) at the 5-s horizon; population: region; 4 episodes
\begin{tabular}{lcccc}
\toprule
Model & S1 & S2 & own & Mean \\
\midrule
CV & 9.08 & 17.28 & 32.00 & 19.45 \\
net v\_1 & 14.24 & 25.30 & 64.00 & 34.51 \\
\bottomrule
\end{tabular}
"""


def test_without_the_paper() -> None:
    tables = latex_tables(score_table(reported_scores()), compare_paper=False)
    assert list(tables) == ["prediction.tex", "rmse.tex", "best_of_six.tex", "miss_rate.tex"]
    assert tables["rmse.tex"] == OWN.lstrip()
    assert "\nCV & 2.10/6.30 & 4.00/12.00 & 8.00/24.00 & 4.70/14.10 \\\\\n" in tables["prediction.tex"]
    assert "\nCV & 1.05/3.15 & 2.00/6.00 & 4.00/12.00 & 2.35/7.05 \\\\\n" in tables["best_of_six.tex"]
    assert "\nCV & 0.60 & 1.00 & 1.00 & 0.87 \\\\\n" in tables["miss_rate.tex"]


def test_with_the_paper() -> None:
    tables = latex_tables(score_table(reported_scores()), compare_paper=True)
    lines = tables["prediction.tex"].splitlines()
    assert lines[1] == r"\begin{tabular}{lccccccccc}"
    assert lines[3] == r"Model & S1 & S2 & S3 & S4 & S5 & S6 & S7 & own & Mean \\"
    assert lines[5] == r"CV & 2.10/6.30 & 4.00/12.00 & -/- & -/- & -/- & -/- & -/- & 8.00/24.00 & 4.70/14.10 \\"
    assert lines[7] == r"\midrule"
    values = "1.63/4.30 1.17/3.11 0.96/2.40 0.68/1.65 1.95/5.03 2.86/7.56 0.85/2.08 -/- 1.44/3.73"
    assert lines[8] == " & ".join(["CV (paper)", *values.split()]) + r" \\"
    assert lines[17:] == [r"\bottomrule", r"\end{tabular}"]
    assert r"DeMo (paper) & 0.53/1.12 & 0.47/1.24 &" in tables["best_of_six.tex"]
    # The paper has no miss rates: nothing stands between our rows and the end.
    assert tables["miss_rate.tex"].splitlines()[-3].startswith(r"net v\_1 &")
