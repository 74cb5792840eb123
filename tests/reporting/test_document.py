"""The document model: every writer shows all blocks, and text from outside stays text."""

import json
import math
import re

import pandas as pd
from markupsafe import Markup

from bench.reporting.document import (
    Bar,
    Cell,
    Choice,
    Code,
    Column,
    Drawing,
    Filters,
    Group,
    Heading,
    Items,
    Paragraph,
    Picture,
    Report,
    Table,
    to_html,
    to_json,
    to_markdown,
    to_page,
)
from tests.reporting.printed import printed, texts

HOSTILE = "# a|b <script>x</script> `c` *d* [e](f) &lt; $x$ 50 % {y} \\z\x1b[2J\n::error::p\u202e"
TABLE = Table(
    title="Found",
    columns=["Kind", Column("Detection rate", lambda share: f"{100 * share:.1f} %"), "cases"],
    rows=[["crossing", 0.5, 12], ["static", Cell("n/a", ("(0 cases)",)), None]],
    note="Of all images.",
)


def everything(text):
    return [
        Heading(text, 1),
        Paragraph(text),
        Paragraph(text, "strong"),
        Items([text]),
        Code(text),
        Picture("a.png", text, text),
        Group(look="folded", title=text, blocks=[Paragraph(text)]),
        Table(title=text, columns=[text, text], rows=[[text, Cell(text, (text,), "bad", link="#a")]], note=text),
    ]


def test_markdown_writes_a_table_with_its_title_and_note_and_ends_code_where_it_ends():
    assert to_markdown([Code("a\n```\nb")]) == "````\na\n```\nb\n````\n"
    assert to_markdown([Heading("Results"), TABLE]) == (
        "## Results\n\n**Found**\n\n| Kind | Detection rate | cases |\n|:--|--:|--:|\n| crossing | 50.0 % | 12 |\n"
        "| static | n/a<br>(0 cases) |  |\n\nOf all images.\n"
    )


def test_markdown_reads_nothing_in_text_from_outside():
    text = to_markdown(everything(HOSTILE))
    code = re.search(r"^```\n.*?\n```$", text, re.MULTILINE | re.DOTALL)[0]
    others = text.replace(code, "")
    assert r"# a|b <script>x</script> `c` *d*" in code, "as it is"
    assert r"\# a\|b &lt;script>x&lt;/script> \`c\` \*d\* [e]\(f) &amp;lt; \$x\$ 50 % {y} \\z\\u001b" in others
    assert "<script" not in others
    assert all(line.isprintable() for line in text.splitlines())
    assert [line for line in others.splitlines() if line.startswith("#")] == [f"# {others[2:].splitlines()[0]}"]
    (row,) = [line for line in others.splitlines() if line.startswith(r"| # a")][1:]
    assert len(re.findall(r"(?<!\\)\|", row)) == 3


def test_a_paragraph_of_markdown_is_no_list_heading_or_code():
    for text in ("1. one", "- one", "> one", "## one", "    + one", "===", "12) one"):
        assert re.match(r"\d*\\[#>+=.)-]", to_markdown([Paragraph(text)])), text
        assert re.match(r"- \d*\\[#>+=.)-]", to_markdown([Items([text])])), text


def test_html_draws_bars_and_escapes_text():
    bar = Bar(share=0.5, interval=(0.25, 0.75))
    table = Table(columns=["a", "b"], rows=[["x", Cell("50 %", ("25 to 75",), "strong", bar)]])
    shown = to_html([table])
    assert '<th scope="row">' in shown
    assert '--v:50.0%"><i></i><b style="--l:25.0%;width:50.0%"></b></span>' in shown
    assert "<small>25 to 75</small>" in shown
    shown = to_html(everything("<script>x</script>\"' onerror='y'>&"))
    assert "<script" not in shown
    assert shown.count("&lt;script&gt;") == shown.count("x&lt;/script&gt;&#34;&#39; onerror=&#39;y&#39;&gt;&amp;") == 18
    assert "<details><summary>" in shown


def test_groups_are_headings_of_text_and_frames_of_a_page():
    rows = [Paragraph("Said."), Drawing(Markup("<svg></svg>")), Filters([Choice("a", "A")])]
    section = Group(look="section", title="Part", name="part", blocks=rows, tags={"a": "x"})
    assert to_markdown([section]) == "## Part\n\nSaid.\n"
    shown = to_html([section])
    assert '<section id="part" data-a="x"><details class="part" open><summary><h2>Part</h2>' in shown
    assert "<figure><svg></svg></figure>" in shown
    assert '<select data-filter="a" data-chosen="">' in shown


def test_a_page_has_a_navigation_where_it_has_sections():
    sections = [Group(look="section", title=name, name=name, blocks=[Paragraph(name)]) for name in "abc"]
    page = to_page("A <title>", [Paragraph("First."), *sections])
    assert "<title>A &lt;title&gt;: fisheye-bench</title>" in page
    assert page.index("First.") < page.index('<nav aria-label="Sections">') < page.index("<main>")
    assert re.findall(r'<a href="#(.)">', page) == ["a", "b", "c"]
    assert "<nav" not in to_page("a", sections[:2])


def test_the_terminal_shows_all_blocks_and_no_character_acts():
    shown = printed([Heading("Results"), TABLE])
    assert [line.split() for line in shown.splitlines() if line.strip(" ─")] == [
        ["Results"], ["Found"], ["Detection"], ["Kind", "rate", "cases"], ["crossing", "50.0", "%", "12"],
        ["static", "n/a"], ["(0", "cases)"], ["Of", "all", "images."]
    ]  # fmt: skip
    shown = printed(everything(HOSTILE))
    assert not re.search(r"^\s*::error", shown, re.MULTILINE)
    assert all(c == "\n" or c.isprintable() for c in shown)


def test_a_first_word_that_repeats_the_one_above_is_left_out_on_the_terminal():
    shown = printed([Table(columns=["a", "b", "c"], rows=[["x", "1", 2], ["x", "2", 2], ["y", "3", 2]], words=2)])
    assert [line.split() for line in shown.splitlines()[2:]] == [["x", "1", "2"], ["2", "2"], ["y", "3", "2"]]


def test_a_table_without_rows_shows_its_headings():
    assert printed([Table(columns=["a", "share"], rows=[])]).split()[:2] == ["a", "share"]


def test_a_frame_is_a_table():
    frame = pd.DataFrame({"name": ["a", "b"], "share": [0.5, math.nan], "count": [1, 2]})
    table = Table(columns=["name", Column("share", "{:.1f}".format), "count"], rows=frame)
    assert texts(table) == [["a", "0.5", "1"], ["b", "nan", "2"]]
    by_name = Table(
        columns={"count": "Count", "share": Column("share", lambda share: Cell(f"{share}", ("x",)))}, rows=frame
    )
    first, _ = by_name.cells()
    assert [(cell.text, cell.below) for cell in first] == [("1", ()), ("0.5", ("x",))]
    assert by_name.headings() == ["Count", "share"]


def test_json_carries_numbers_without_loss():
    content = {"a": [math.nan, (1 / 3, math.inf)], "b": {"ü": None}}
    assert json.loads(to_json(content)) == {"a": [None, [1 / 3, None]], "b": {"ü": None}}


def test_a_report_writes_the_files_that_it_has_and_its_title_once(tmp_path):
    blocks, numbers = [Paragraph("Said."), TABLE], pd.DataFrame({"a": [1 / 3, math.nan], "c": ['x,"', None]})
    few = Report(title="", blocks=blocks, numbers=numbers).write(tmp_path, "few")
    assert [file.name for file in few] == ["few.md", "few.csv"]
    assert few[0].read_text() == to_markdown(blocks)
    every = Report(title="A & b", blocks=blocks, numbers=numbers, page=True)
    page, markdown, table = every.write(tmp_path / "new", "every")
    assert page.read_text().count("<h1>A &amp; b</h1>") == page.read_text().count("<h1>") == 1
    assert markdown.read_text() == f"# A & b\n\n{to_markdown(blocks)}"
    assert table.read_text() == f'a,c\n{1 / 3!r},"x,"""\n,\n', "without loss, and empty for NaN and None"
