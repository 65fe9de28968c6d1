"""What the command line advises: an option that it names has to be one of the command that names it."""

import re
from functools import cache

import typer.main

from wbf_mission.cli.app import app

FLAG = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]*(?![\w{-])")


@cache
def commands():
    """The commands by their names, such as "farm show"."""
    found = {}
    for name, command in typer.main.get_command(app).commands.items():
        inner = getattr(command, "commands", None)
        found |= {name: command} if inner is None else {f"{name} {one}": of for one, of in inner.items()}
    return found


def flags_of(name):
    params = [param for param in commands()[name].params if param.param_type_name == "option"]
    return {"--help", *(flag for param in params for flag in (*param.opts, *param.secondary_opts))}


def named_in(text):
    """The longest name of a command with which a text begins; None if it does with none."""
    fits = [name for name in commands() if re.match(rf"{name}(?![\w-])", text)]
    return max(fits, key=len, default=None)


def misadvice(arguments, text):
    """The options that a text names and the command has not that says it, or is named before them."""
    own = named_in(" ".join(map(str, arguments[:2])))
    wrong = []
    for found in FLAG.finditer(text):
        before = re.split(r"wbf-mission |\(|'", text[: found.start()])[-1]
        whose = named_in(before) or own
        given = any(str(word).split("=")[0] == found[0] for word in arguments)
        if whose is not None and not given and found[0] not in flags_of(whose):
            wrong.append(f"{whose} {found[0]}")
    return wrong
