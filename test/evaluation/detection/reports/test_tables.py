"""The same cells for the terminal, as CSV and as LaTeX."""

from siren_ros.evaluation.detection.reports.tables import Table, as_csv, as_latex, as_text

TABLE = Table("name", "a caption", ("detector", "S_1", "mean"), (("one & two", ".5", "-"), ("3", ".25", "50 %")))


def test_text_has_a_column_for_each_of_the_head() -> None:
    lines = ["a caption:", "", "detector   S_1  mean", "one & two  .5   -", "3          .25  50 %"]
    assert as_text(TABLE) == lines


def test_csv_has_the_head_first() -> None:
    assert as_csv(TABLE) == "detector,S_1,mean\none & two,.5,-\n3,.25,50 %\n"


def test_latex_has_as_many_columns_and_no_special_characters() -> None:
    assert as_latex(TABLE).splitlines() == [
        "% a caption",
        r"\begin{tabular}{lcc}",
        r"\toprule",
        r"detector & S\_1 & mean \\",
        r"\midrule",
        r"one \& two & .5 & - \\",
        r"3 & .25 & 50 \% \\",
        r"\bottomrule",
        r"\end{tabular}",
    ]
