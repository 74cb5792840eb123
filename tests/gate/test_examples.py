"""The CI examples of docs/gate.md: they parse, and every command and option in them exists."""

import shlex
import subprocess
from pathlib import Path

import pytest
import typer.main
import yaml

from bench.commands.app import app

EXAMPLES = sorted((Path(__file__).parents[2] / "docs/examples").glob("gate-*.yml"))
COMMANDS = typer.main.get_command(app).commands


def options_of(command):
    return {option for one in COMMANDS[command].params for option in (*one.opts, *one.secondary_opts)}


def scripts(content):
    """Every line that a shell is given, of a workflow of GitHub or a pipeline of GitLab."""
    if "jobs" in content:
        steps = [step for job in content["jobs"].values() for step in job["steps"]]
        assert all(("uses" in step) != ("run" in step) for step in steps)
        return [line for step in steps if "run" in step for line in step["run"].splitlines()]
    jobs = [job for name, job in content.items() if name != "variables"]
    return [line for job in jobs for part in ("before_script", "script", "after_script") for line in job.get(part, [])]


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_an_example_is_complete_and_its_commands_exist(file):
    called = {}
    lines = scripts(yaml.safe_load(file.read_text("utf-8")))
    for words in (shlex.split(line, comments=True) for line in lines):
        if words[0] == "fisheye-bench":
            assert {word for word in words if word.startswith("--")} <= options_of(words[1]), words
            called.setdefault(words[1], []).append(words)
    assert set(called) == {"validate", "run", "gate"}
    assert ["--update" in words for words in called["gate"]] == [False, False, True]
    assert called["gate"][1][-1] == "target"  # of a change that brings its own baseline
    assert [line for line in lines if "pip " in line] == ['pip install --constraint "$CONSTRAINTS" "$FISHEYE_BENCH"']
    variables = yaml.safe_load(file.read_text("utf-8"))["env" if file.stem == "gate-github" else "variables"]
    assert variables["CONSTRAINTS"].endswith("COMMIT/constraints.txt")
    assert variables["FISHEYE_BENCH"].endswith("@COMMIT")
    assert any("fetch_recordings.sh datasets/data" in line for line in lines)


def test_a_run_with_failures_is_judged_all_the_same(tmp_path):
    """`run` ends with status 2 there, and leaves a summary; without one there is nothing to judge."""
    assert [file.stem for file in EXAMPLES] == ["gate-github", "gate-gitlab"], "one for each server"
    github, gitlab = (yaml.safe_load(file.read_text("utf-8")) for file in EXAMPLES)
    (judged,) = [step for step in github["jobs"]["gate"]["steps"] if "--junit" in step.get("run", "")]
    assert {"!cancelled()", "hashFiles('run/surface-v1/summary.json') != ''"} < set(judged["if"].split(" && "))
    assert not any("fisheye-bench run" in line for line in gitlab[".score"]["before_script"])
    program = tmp_path / "fisheye-bench"
    program.write_text("#!/bin/sh\necho $1 >>called\n[ $1 = gate ] || exit 2\n")
    program.chmod(0o755)
    script = "\n".join(gitlab["gate"]["script"])
    for summary, status, called in ((False, 1, ["run"]), (True, 0, ["run", "run", "gate"])):
        if summary:
            (tmp_path / "run" / "surface-v1").mkdir(parents=True)
            (tmp_path / "run" / "surface-v1" / "summary.json").touch()
        done = subprocess.run(["sh", "-ec", script], cwd=tmp_path, env={"PATH": f"{tmp_path}:/usr/bin:/bin"})
        assert done.returncode == status
        assert (tmp_path / "called").read_text().split() == called


def test_the_action_scores_and_judges():
    action = yaml.safe_load((Path(__file__).parents[2] / "action.yml").read_text("utf-8"))
    steps = [step for step in action["runs"]["steps"] if "fisheye-bench " in step.get("run", "")]
    lines = [line.partition("fisheye-bench ")[1:] for step in steps for line in step["run"].splitlines()]
    called = [shlex.split("".join(line).partition("||")[0]) for line in lines if line[0]]
    assert [words[1] for words in called] == ["run", "gate", "view"]
    for words in called:
        assert {word for word in words if word.startswith("--")} <= options_of(words[1])
    values = " ".join(value for step in steps for value in step["env"].values())
    assert all(f"inputs.{name} " in values for name in action["inputs"]), "each input is used"
