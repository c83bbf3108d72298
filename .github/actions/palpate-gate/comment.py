"""Show the table of a gate in one comment on the pull request; a later run updates that comment.

Nothing that goes wrong here changes the verdict: every way ends with 0, and with one line that says
what was done. REST: https://docs.github.com/rest/issues/comments. No output contains the token.
"""

import hashlib
import json
import os
import urllib.error
import urllib.request
from pathlib import Path

CODES = {
    "0": "passed",
    "1": "failed",
    "2": "not judged, or not all: unusable input",
    "3": "inconclusive",
}
MOST = 65_000  # GitHub takes 65 536 characters
AUTHOR = "github-actions[bot]"  # of comments made with the token of a job
MAY_NOT = (
    "the job's token may not comment on this pull request. The job needs `permissions: "
    "pull-requests: write`; the token of a pull request from a fork only reads, whatever is written"
)


def ask(method: str, path: str, body: str | None = None) -> object:
    """GitHub's reply; `urllib.error.HTTPError` where it refuses."""
    data = None if body is None else json.dumps({"body": body}).encode()
    request = urllib.request.Request(os.environ["GITHUB_API_URL"] + path, data, method=method)
    request.add_header("Accept", "application/vnd.github+json")
    request.add_header("X-GitHub-Api-Version", "2022-11-28")
    # Not sent along where a reply leads to another host.
    request.add_unredirected_header("Authorization", f"Bearer {os.environ['GITHUB_TOKEN']}")
    with urllib.request.urlopen(request, timeout=30) as reply:
        return json.load(reply)


def text(event: dict, marker: str) -> str:
    """The comment: what the gate ended with, for which commit and where, and its table."""
    env = os.environ
    run = f"{env['GITHUB_REPOSITORY']}/actions/runs/{env['GITHUB_RUN_ID']}"
    code, commit = env["CODE"], event["pull_request"]["head"]["sha"][:10]
    verdict = CODES.get(code, f"ended with {code}")
    log = f"[log]({env['GITHUB_SERVER_URL']}/{run})"
    head = f"{marker}\n### palpate gate: {verdict}\n\n`{env['CASES']}` at {commit}, {log}\n\n"
    table = Path(env["TABLE"]).read_text("utf-8") if env["TABLE"] else ""  # of this run, if any
    table = table.replace("@", "@\u200b")  # a name in a message calls nobody
    if len(head + table) > MOST:
        table = table[: MOST - len(head)].rpartition("\n")[0] + "\n\nThe rest is in the log."
    return head + table


def comment() -> str:
    """Write the comment, or update the former one; what was done, in words."""
    event = json.loads(Path(os.environ["GITHUB_EVENT_PATH"]).read_text("utf-8"))
    if "pull_request" not in event:
        return "no comment: this run belongs to no pull request"
    keys = (os.environ[name] for name in ("GITHUB_WORKFLOW", "GITHUB_JOB", "COMMENT_KEY"))
    marker = f"<!-- palpate-gate {hashlib.sha256(repr([*keys]).encode()).hexdigest()[:16]} -->"
    comments = f"/repos/{os.environ['GITHUB_REPOSITORY']}/issues"
    listed = f"{comments}/{event['pull_request']['number']}/comments"
    for page in range(1, 31):
        found = ask("GET", f"{listed}?per_page=100&page={page}")
        for old in found:
            # Somebody else's, though it begins alike, could be edited by that person afterwards.
            author = (old["user"] or {}).get("login")
            if author == AUTHOR and (old["body"] or "").startswith(marker):
                new = ask("PATCH", f"{comments}/comments/{old['id']}", text(event, marker))
                return f"updated comment {new['id']}"
        if len(found) < 100:
            break
    return f"wrote comment {ask('POST', listed, text(event, marker))['id']}"


try:
    print(f"palpate gate: {comment()}")
except urllib.error.HTTPError as error:
    why = MAY_NOT if error.code in (401, 403, 404) else "GitHub refuses it; run the job again"
    print(f"::warning title=palpate gate::no comment ({error.code}): {why}. The verdict stands.")
except Exception as error:  # its words may be anything, the token's among them
    name = type(error).__name__
    print(f"::warning title=palpate gate::no comment ({name}). The verdict stands.")
