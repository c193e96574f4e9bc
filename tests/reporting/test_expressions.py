import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from uncertainties import ufloat

from repro.reporting.expressions import Names, evaluate

NAMES = Names({"networks": 4, "pair": ["3", "4"], "exp": "3"}, {"m": lambda metric, exp, model="average": len(model)})


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("networks", 4),
        ("100 * (m('ssim', exp) - m('ssim', pair[1], model='unet'))", 300),
        ("-networks / 8 + 0.5", 0),
        ("m('accuracy', ['1', '2'])", 7),
        ("pair[0]", "3"),
        ("\n  1 + 2\n", 3),
    ],
)
def test_arithmetic_on_numbers_by_name(text, value):
    assert evaluate(text, NAMES) == value


def test_standard_errors_pass_through():
    assert evaluate("x - 1", Names({"x": ufloat(2, 0.5)})).std_dev == 0.5


@pytest.mark.parametrize(
    "text",
    [
        "().__class__.__bases__[0].__subclasses__()",
        "networks.__class__",
        "m.__globals__",
        "m('a', exp).__class__",
        "__import__('os').system('true')",
        "open('/etc/passwd')",
        "(lambda: 1)()",
        "[x for x in pair]",
        "exp.format(1)",
        "f'{exp}'",
        "m(*pair)",
        "m(**{})",
        "m",
        "pair[exp]",
        "pair[0:1]",
        "pair[0][0]",
        "2 ** 99999999",
        "networks if True else 0",
        "networks == 4",
        "(x := 3)",
        "True",
        "b'1'",
        "unknown + 1",
        "1 +",
        "import os",
        "",
        "(" * 500 + "1" + ")" * 500,
    ],
)
def test_anything_else_is_refused(text):
    with pytest.raises(ValueError, match=r"is not (allowed|an expression)"):
        evaluate(text, NAMES)


@given(st.text(alphabet="mpair()[]'\".,+-*/ 0123_x{}:=", max_size=40))
def test_no_text_does_anything_but_evaluate_or_raise(text):
    with contextlib.suppress(ValueError, TypeError, ArithmeticError, IndexError):
        evaluate(text, NAMES)
