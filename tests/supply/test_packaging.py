"""The conda recipe and the container's definition agree with pyproject.toml and the lock file."""

import re
import subprocess
import tomllib
from typing import Any

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

from tests.supply.lock import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
WHEEL = f"{PROJECT['name'].replace('-', '_')}-{PROJECT['version']}-py3-none-any.whl"
RECIPE = ROOT / "packaging" / "conda" / "recipe.yaml"
DEFINITION = ROOT / "packaging" / "apptainer" / "sinew.def"
CALLED = {"dask": "dask-core", "matplotlib": "matplotlib-base"}  # by conda-forge, whose plain names bring more


def rendered() -> dict[str, Any]:
    """The recipe with its own variables put in."""
    text = RECIPE.read_text("utf-8")
    context = yaml.safe_load(text)["context"]
    found = yaml.safe_load(re.sub(r"\$\{\{ (\w+) \}\}", lambda name: str(context[name.group(1)]), text))
    assert isinstance(found, dict)
    return found


def sections() -> dict[str, str]:
    """The sections of the definition by name; the lines above the first one are ``""``."""
    parts = re.split(r"^%(\w+)\n", DEFINITION.read_text("utf-8"), flags=re.MULTILINE)
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def test_the_recipe_asks_for_what_the_project_asks_for():
    asked = {}
    for line in PROJECT["dependencies"]:
        one = Requirement(line)
        name = canonicalize_name(one.name)
        asked[CALLED.get(name, name)] = one.specifier
    python, *others = rendered()["requirements"]["run"]
    assert python == f"python {PROJECT['requires-python']}"
    found = dict(line.partition(" ")[::2] for line in others)
    assert list(found) == sorted(found)
    assert {name: SpecifierSet(words) for name, words in found.items()} == asked


def test_the_recipe_is_of_this_version_and_starts_the_same_command():
    recipe = rendered()
    assert recipe["package"] == {"name": PROJECT["name"], "version": PROJECT["version"]}
    assert recipe["source"]["path"] == f"../../dist/{WHEEL}"
    assert WHEEL in recipe["build"]["script"]
    (entry,) = recipe["build"]["python"]["entry_points"]
    assert dict([entry.split(" = ")]) == PROJECT["scripts"]
    assert recipe["about"]["summary"] == PROJECT["description"]
    (host,) = [line for line in recipe["requirements"]["host"] if line.startswith("python ")]
    assert SpecifierSet(PROJECT["requires-python"]).contains(host.removeprefix("python ").removesuffix(".*"))


def test_the_container_holds_the_wheel_of_this_version_and_locked_packages():
    found = sections()
    (python,) = re.findall(r"^From: python:(\d+\.\d+)-", found[""], re.MULTILINE)
    assert SpecifierSet(PROJECT["requires-python"]).contains(python)
    copied = [line.split()[0] for line in found["files"].splitlines() if line.strip()]
    assert copied == [f"dist/{WHEEL}", f"dist/{WHEEL.split('-py3')[0]}.requirements.txt"]
    assert f"version {PROJECT['version']}\n" in found["labels"]
    post = " ".join(found["post"].replace("\\\n", " ").split())
    assert "--require-hashes --requirement requirements.txt" in post
    assert "--no-deps sinew_fe-*.whl" in post


@pytest.mark.parametrize("name", ["post", "runscript", "test", "environment"])
def test_the_scripts_of_the_container_are_those_of_a_plain_shell(name):
    done = subprocess.run(["sh", "-n"], input=sections()[name], text=True, capture_output=True)
    assert (done.returncode, done.stderr) == (0, "")
