"""The GitHub Action: its shell steps, run here with what GitHub would put into them."""

from __future__ import annotations

import copy
import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest

ROOT = Path(__file__).parent.parent
ACTION = ROOT / ".github" / "actions" / "palpate-gate" / "action.yml"
WORKFLOW = ROOT / ".github" / "workflows" / "palpate-gate.yml"
RECORDED = ROOT / "tests" / "bank" / "github_comments.json"
TOKEN = "ghs_0123456789abcdefghijklmnopqrstuvwxyz"
LISTED = "/repos/octocat/Hello-World/issues/1347/comments"
TOY = ROOT / "validation" / "examples" / "gate_your_simulator"

pytestmark = pytest.mark.once


def judge(folder: Path, simulator: str, cases: str = "bar.toml", **asked: str) -> tuple[int, str]:
    """The exit code of the step that judges, and the job's summary."""
    yaml = pytest.importorskip("yaml")
    (step,) = (
        s for s in yaml.safe_load(ACTION.read_text())["runs"]["steps"] if "Judge" in s["name"]
    )
    shutil.copytree(TOY, folder, dirs_exist_ok=True)
    program = folder / "bin" / "palpate"
    program.parent.mkdir(exist_ok=True)
    run = f"exec {sys.executable} -m palpate.validation.cli"
    program.write_text(f'#!/bin/sh\nprintf "%s\\n" "$@" > words\n{run} "$@"\n')
    program.chmod(0o755)
    summary, output = folder / "step-summary.md", folder / "step-output.txt"
    inputs = {"CASES": cases, "SIMULATOR": simulator, "TIME_LIMIT": "60"}
    inputs |= dict.fromkeys(("ELEMENT", "LAW", "INTEGRATOR", "TIME_STEP"), "") | asked
    assert set(inputs) == set(step["env"])  # nothing else of the caller's reaches the shell
    assert "${{" not in step["run"]
    path = f"{program.parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, **inputs, "PATH": path, "GITHUB_STEP_SUMMARY": str(summary)}
    environment["GITHUB_OUTPUT"] = str(output)
    done = subprocess.run(
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]],
        cwd=folder, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    # What the comment is made from.
    table = "table=summary.md\n" if summary.exists() else ""
    assert output.read_text() == f"code={done.returncode}\n{table}"
    return done.returncode, summary.read_text() if summary.exists() else done.stderr


def test_a_simulator_that_passes_passes_the_job_and_its_table_is_shown(tmp_path: Path) -> None:
    code, summary = judge(tmp_path, f"{sys.executable} toy_simulator.py {{case}} {{result}}")
    assert code == 0, summary
    assert "passed" in summary
    assert (tmp_path / "results.json").is_file()


def test_one_that_fails_turns_the_job_red_and_its_table_is_shown_too(tmp_path: Path) -> None:
    code, summary = judge(
        tmp_path, f"{sys.executable} -c 'raise SystemExit(3)' {{case}} {{result}}"
    )
    assert code == 1, summary
    assert "failed" in summary


def test_words_of_an_input_are_no_commands(tmp_path: Path) -> None:
    code, _ = judge(tmp_path, "none {case} {result}", cases="bar.toml; touch stolen")
    assert code not in (0, 1)
    assert not (tmp_path / "stolen").exists()


def test_element_law_scheme_and_step_are_passed_on(tmp_path: Path) -> None:
    (tmp_path / "summary.md").write_text("of before")
    code, said = judge(
        tmp_path, "none {case} {result}",
        ELEMENT="both; touch stolen", LAW="neo-hookean\n saint-venant-kirchhoff",
        INTEGRATOR="backward-euler", TIME_STEP="1e-3",
    )  # fmt: skip
    assert (code, said[:8]) == (2, "palpate:")  # and no table of an earlier run
    words = (tmp_path / "words").read_text().splitlines()
    given = [*words[words.index("--law") : words.index("--json")]]
    assert given == [
        "--law", "neo-hookean", "--law", "saint-venant-kirchhoff",
        "--element", "both; touch stolen", "--integrator", "backward-euler",
        "--time-step", "1e-3",
    ]  # fmt: skip
    yaml = pytest.importorskip("yaml")
    (step,) = (s for s in yaml.safe_load(ACTION.read_text())["runs"]["steps"] if "id" in s)
    for name in ("element", "law", "integrator", "time-step"):
        assert step["env"][name.upper().replace("-", "_")] == f"${{{{ inputs.{name} }}}}"


# --------------------------------------------------------------------------------- the comment
class GitHub:
    """The part of GitHub's REST interface that comments on issues, by replies as recorded.

    Attributes:
        comments: What stands below the pull request.
        asked: Method and path of every request, in their order.
        refuses: Name of the recorded reply for each method that is refused.
        elsewhere: Address to which every request is sent on, "" for none.
        tokens: The header Authorization of every request.
    """

    address = ""  # of the server that speaks for it

    def __init__(self) -> None:
        self.recorded: dict[str, Any] = json.loads(RECORDED.read_text("utf-8"))
        self.comments: list[dict[str, Any]] = self.recorded["list"]["body"]
        self.asked: list[str] = []
        self.refuses: dict[str, str] = {}
        self.elsewhere = ""
        self.tokens: list[str | None] = []

    def comment(self, body: str, login: str = "github-actions[bot]") -> dict[str, Any]:
        """A further comment, as the recorded one but for its text and author."""
        new = copy.deepcopy(self.recorded["create"]["body"])
        new |= {"id": 3 + len(self.comments), "body": body, "user": {"login": login}}
        self.comments.append(new)
        return new

    def reply(self, method: str, path: str, body: str) -> tuple[int, Any]:
        """Status and content of the reply to a request."""
        split = urlsplit(path)
        self.asked.append(f"{method} {split.path}")
        if method in self.refuses:
            refusal = self.recorded[self.refuses[method]]
            return refusal["status"], refusal["body"]
        if method == "GET" and split.path == LISTED:
            asked = {name: int(value[0]) for name, value in parse_qs(split.query).items()}
            first = (asked["page"] - 1) * asked["per_page"]
            return self.recorded["list"]["status"], self.comments[first : first + asked["per_page"]]
        if method == "POST" and split.path == LISTED:
            return self.recorded["create"]["status"], self.comment(json.loads(body)["body"])
        for old in self.comments:
            if (method, split.path) == ("PATCH", LISTED.replace("1347/", "") + f"/{old['id']}"):
                old["body"] = json.loads(body)["body"]
                return 200, old
        return 404, {"message": "Not Found", "status": "404"}


def serve(github: GitHub) -> ThreadingHTTPServer:
    """A server of it on a free port of this machine."""

    class Handler(BaseHTTPRequestHandler):
        def answer(self) -> None:
            github.tokens.append(self.headers.get("Authorization"))
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0)).decode()
            if github.elsewhere:
                self.send_response(307)
                self.send_header("Location", github.elsewhere + self.path)
                self.end_headers()
                return
            status, content = github.reply(self.command, self.path, body)
            assert self.headers["X-GitHub-Api-Version"] == "2022-11-28"
            data = json.dumps(content).encode()
            self.send_response(status)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        do_GET = do_POST = do_PATCH = answer  # noqa: N815  (http.server's names)

        def log_message(self, *_args: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


@pytest.fixture
def github() -> Iterator[GitHub]:
    stored = GitHub()
    server = serve(stored)
    stored.address = f"http://127.0.0.1:{server.server_port}"
    yield stored
    server.shutdown()
    server.server_close()


EVENT = {
    "pull_request": {"number": 1347, "head": {"sha": "6dcb09b5b57875f334f61aebed695e2e4193db5e"}}
}


def comment(folder: Path, github: GitHub, code: str = "0", **others: str) -> str:
    """What the step that comments says; it ends with 0 whatever happens."""
    yaml = pytest.importorskip("yaml")
    steps = yaml.safe_load(ACTION.read_text())["runs"]["steps"]
    (step,) = (s for s in steps if "Comment" in s["name"])
    event = folder / "event.json"
    event.write_text(others.pop("event", json.dumps(EVENT)))
    given = {
        "CASES": "bar.toml", "CODE": code, "COMMENT_KEY": "", "GITHUB_TOKEN": TOKEN,
        "SCRIPT": str(ACTION.parent / "comment.py"), "TABLE": others.pop("TABLE", ""),
    }  # fmt: skip
    assert set(given) == set(step["env"])
    assert "${{" not in step["run"]
    given |= {
        "GITHUB_API_URL": github.address,
        "GITHUB_SERVER_URL": "https://github.com", "GITHUB_REPOSITORY": "octocat/Hello-World",
        "GITHUB_RUN_ID": "30433642", "GITHUB_EVENT_PATH": str(event), "GITHUB_WORKFLOW": "CI",
        "GITHUB_JOB": "gate", "no_proxy": "*",
    }  # fmt: skip
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]],
        cwd=folder, env={**os.environ, "PATH": path, **given, **others},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert TOKEN not in done.stdout + done.stderr
    assert done.stdout.count("\n") == 1
    assert done.stderr == ""
    return done.stdout


TABLE = "| bar | displacement_l2 | 8.61e-11 | passed | as @octocat asks |\n"


def test_a_second_run_updates_the_comment_of_the_first(tmp_path: Path, github: GitHub) -> None:
    (tmp_path / "summary.md").write_text(TABLE)
    assert comment(tmp_path, github, TABLE="summary.md") == "palpate gate: wrote comment 5\n"
    first = github.comments[-1]["body"]
    assert (
        "### palpate gate: passed\n\n`bar.toml` at 6dcb09b5b5, [log](https://github.com/" in first
    )
    assert "octocat/Hello-World/actions/runs/30433642" in first
    assert TABLE.replace("@", "@\u200b") in first  # nobody is called by what a table says
    assert comment(tmp_path, github, "1") == "palpate gate: updated comment 5\n"
    assert len(github.comments) == 3
    assert "### palpate gate: failed" in github.comments[-1]["body"]
    assert [line.split()[0] for line in github.asked] == ["GET", "POST", "GET", "PATCH"]
    assert set(github.tokens) == {f"Bearer {TOKEN}"}


def test_jobs_and_their_variants_have_comments_of_their_own(tmp_path: Path, github: GitHub) -> None:
    (tmp_path / "summary.md").write_text(TABLE)
    for others in ({}, {"GITHUB_JOB": "other"}, {"COMMENT_KEY": "macos"}, {"GITHUB_WORKFLOW": "W"}):
        assert "wrote" in comment(tmp_path, github, **others)
        assert "updated" in comment(tmp_path, github, **others)


def test_a_comment_of_somebody_else_is_not_written_over(tmp_path: Path, github: GitHub) -> None:
    comment(tmp_path, github)
    mine = github.comments.pop()["body"]
    github.comment(mine, login="mallory")
    github.comment(f"> {mine}")
    before = [old["body"] for old in github.comments]
    assert "wrote" in comment(tmp_path, github)
    assert [old["body"] for old in github.comments[:-1]] == before


def test_the_former_comment_is_found_below_more_than_a_page(tmp_path: Path, github: GitHub) -> None:
    for _ in range(150):
        github.comment("Me too", login="octocat")
    comment(tmp_path, github)
    assert "updated" in comment(tmp_path, github)
    assert github.asked.count(f"GET {LISTED}") == 4


@pytest.mark.parametrize("name", ["may not", "bad token"])
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_a_token_that_may_not_comment_is_said_and_what_to_do(
    method: str, name: str, tmp_path: Path, github: GitHub
) -> None:
    github.refuses[method] = name
    said = comment(tmp_path, github)
    assert said.startswith("::warning title=palpate gate::no comment (40")
    assert "may not comment" in said
    assert "pull-requests: write" in said
    assert "a fork only reads" in said
    assert said.endswith("The verdict stands.\n")


def test_what_goes_wrong_otherwise_is_said_and_changes_nothing(
    tmp_path: Path, github: GitHub
) -> None:
    for name, status in (("down", 503), ("validation", 422)):
        github.refuses["POST"] = name
        assert f"no comment ({status}): GitHub refuses it" in comment(tmp_path, github)
    github.refuses.clear()
    assert "belongs to no pull request" in comment(tmp_path, github, event='{"ref": "main"}')
    assert "no comment (JSONDecodeError)" in comment(tmp_path, github, event="no JSON")
    assert "no comment (" in comment(tmp_path, github, GITHUB_API_URL="http://127.0.0.1:9")
    # Python names a header that it cannot send, value and all.
    broken = f"{TOKEN}\nX-More: 1"
    assert "no comment (ValueError)" in comment(tmp_path, github, GITHUB_TOKEN=broken)


def test_the_token_does_not_follow_to_another_host(tmp_path: Path, github: GitHub) -> None:
    other = GitHub()
    server = serve(other)
    github.elsewhere = f"http://localhost:{server.server_port}"
    comment(tmp_path, github)
    server.shutdown()
    server.server_close()
    assert other.asked[0].startswith("GET")
    assert set(other.tokens) == {None}
    assert github.tokens[0] == f"Bearer {TOKEN}"


def test_no_table_of_an_earlier_run_is_shown_and_a_long_one_is_cut(
    tmp_path: Path, github: GitHub
) -> None:
    summary = tmp_path / "summary.md"
    summary.write_text(TABLE)
    comment(tmp_path, github, "2")
    assert "not judged, or not all: unusable input" in github.comments[-1]["body"]
    assert "8.61e-11" not in github.comments[-1]["body"]
    summary.write_text(TABLE * 2000)
    comment(tmp_path, github, TABLE="summary.md")
    body = github.comments[-1]["body"]
    assert 60_000 < len(body) < 65_536
    assert body.endswith("|\n\nThe rest is in the log.")


def test_it_comments_only_when_asked_and_its_failure_is_none_of_the_job() -> None:
    yaml = pytest.importorskip("yaml")
    action = yaml.safe_load(ACTION.read_text())
    assert action["inputs"]["comment"]["default"] == "false"
    with_token = [s for s in action["runs"]["steps"] if "GITHUB_TOKEN" in s["env"]]
    (step,) = with_token  # no other step, and so no simulator, has the token
    assert "inputs.comment == 'true'" in step["if"]
    assert step["continue-on-error"] is True


def test_the_workflow_tries_the_action_with_inputs_that_it_has() -> None:
    yaml = pytest.importorskip("yaml")
    known = set(yaml.safe_load(ACTION.read_text())["inputs"])
    jobs = yaml.safe_load(WORKFLOW.read_text())["jobs"]
    uses = [s for job in jobs.values() for s in job["steps"] if "palpate-gate" in s.get("uses", "")]
    assert len(uses) == 2
    for step in uses:
        assert set(step["with"]) <= known
        for word in f"{step['with']['cases']} {step['with']['simulator']}".split():
            assert "/" not in word or (ROOT / word).is_file(), word
