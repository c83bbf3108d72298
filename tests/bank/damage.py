"""Damaged copies of whole files, with a fixed seed, so that a failure comes back."""

import re
import warnings
from contextlib import contextmanager

import numpy as np

from palpate.meshes.errors import InputError
from palpate.validation.states import CandidateFailedError

WORDS = (
    b"nan", b"-inf", b"1e308", b"-1e308", b"1e-320", b"0", b"-1", b"3", b"true", b"null", b'"x"',
    b"[]", b"{}", b"[[[[[[", b"1" + b"0" * 350, b"2147483648", b"1e400", b"\x00", b"\xff\xfe",
    b"\\u0000", b"=", b"2020-01-01", b'"\\ud800"', b"\n", b"..", b"/dev/zero", b"<", b">", b"&amp;",
    b"&#0;", b"&x;", b"*", b"*STEP", b",", b"1:5", b"<!-- ", b"]]>",
)  # fmt: skip
_TOKEN = re.compile(rb"[\w.+-]+|[\[\]{}\"=,:<>/*]")


def damaged_copies(whole, count, seed):
    """Bytes with one to three pieces turned, left out, doubled or put in place of another."""
    rng = np.random.default_rng(seed)
    tokens = [m.span() for m in _TOKEN.finditer(whole)]
    for _ in range(count):
        data = whole
        for _ in range(int(rng.integers(1, 4))):
            kind = rng.integers(5)
            start = int(rng.integers(max(len(data), 1)))
            stop = start + int(rng.integers(1, 50))
            if kind == 0:
                flipped = bytes(b ^ int(rng.integers(1, 256)) for b in data[start : start + 1])
                data = data[:start] + flipped + data[start + 1 :]
            elif kind == 1:
                data = data[:start] + data[stop:]
            elif kind == 2:
                data = data[:stop] + data[start:]
            else:
                first, last = tokens[int(rng.integers(len(tokens)))]
                data = data[:first] + WORDS[int(rng.integers(len(WORDS)))] + data[last:]
        yield data


@contextmanager
def only_refusals(data):
    """Numbers may overflow here; what comes of it may only be a refusal or a failed candidate."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (InputError, CandidateFailedError):
        return
    except Exception as error:
        raise AssertionError(f"{type(error).__name__}: {error}; input {data!r}"[:6000]) from error
