"""Crates of other studies, made by the command and run again elsewhere: a model of one's own, options of a run."""

import contextlib
import re
import shlex
import shutil
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.cli.main import main
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.report.crate.source import read_source
from sinew.tasks.study import pipeline
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import Workspace
from tests.docs_pages import ROOT, dogbone

Sinew = Callable[..., None]


@pytest.fixture
def sinew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Sinew:
    """Runs the command in a folder, in this process, without a cluster and figures."""
    monkeypatch.setattr(Workspace, "client", lambda self: None)
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)
    (tmp_path / "bin").mkdir()
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), prepend=":")

    def run(where: Path, *words: object) -> None:
        monkeypatch.setattr(sys, "argv", ["sinew", *map(str, words)])
        with contextlib.chdir(where):
            main()

    return run


def repeated(crate: Path, where: Path, sinew: Sinew) -> list[str]:
    """The README's commands that were run in an unpacked crate; its comparisons hold."""
    with zipfile.ZipFile(crate) as archive:
        archive.extractall(where)
    *_, block = re.findall(r"```sh\n(.*?)```", (where / "README.md").read_text("utf-8"), re.DOTALL)
    lines = block.splitlines()
    for line in lines:
        program, *words = shlex.split(line)
        if program == "cmp":
            assert (where / words[0]).read_bytes() == (where / words[1]).read_bytes(), line
        else:
            sinew(where, *words, "--quiet")
    assert any(line.startswith("cmp ") for line in lines)
    return [line for line in lines if not line.startswith("cmp ")]


def test_a_model_of_ones_own_comes_with_its_template(tmp_path, sinew):
    home = tmp_path / "home"
    home.mkdir()
    (home / "bin").mkdir()
    dogbone(home)
    shutil.copy(home / "bin" / "febio4", tmp_path / "bin" / "febio4")
    sinew(home, "run", "configs/dogbone.yaml", "--quiet")
    sinew(home, "export", "results/dogbone", "--ro-crate", "--out", tmp_path / "dogbone.zip")
    own = home / "configs" / "dogbone" / "dogbone.feb.j2"
    own.write_text(own.read_text().replace("E_matrix", "2 * E_matrix", 1))
    with pytest.raises(BadInput, match=r"dogbone\.feb\.j2: is not the template of these results, or a file"):
        read_source(home / "results" / "dogbone", home / "configs" / "dogbone.yaml")
    shutil.rmtree(home)
    done = repeated(tmp_path / "dogbone.zip", tmp_path / "there", sinew)
    assert done == ["sinew run configs/dogbone.yaml --out results/dogbone-again"]
    template = ROOT / "configs" / "dogbone" / "dogbone.feb.j2"
    assert (tmp_path / "there" / "configs" / "dogbone" / "dogbone.feb.j2").read_bytes() == template.read_bytes()
    text = (tmp_path / "there" / "METHODS.md").read_text("utf-8")
    assert "given as a template in this crate" in text
    assert "as `febio4` on the PATH" in (tmp_path / "there" / "README.md").read_text("utf-8")


@pytest.mark.thorough
def test_options_of_the_run_and_doublings_are_repeated(tmp_path, sinew):
    home, data = tmp_path / "home", tmp_path / "far" / "away" / "from" / "the" / "study"
    home.mkdir()
    specimens, truth = virtual_cohort(seed=3, per_site=1, rate_hz=1)
    write_cohort(data, specimens[:1], truth)
    study = "# ours\nname: small\ncluster: {name: local, workers: 1}\nsobol: {base_samples: 4, resamples: 10}\n"
    study += "importance: {trees: 10, repeats: 2}\n"
    (home / "study.yaml").write_text(study)
    for words in (["sobol"], ["importance"], ["sobol", "--extend"]):
        command, *flags = words
        sinew(home, command, "study.yaml", "--data", data, "--seed", 9, "--quiet", *flags)
    sinew(home, "export", "results/small", "--ro-crate", "--out", tmp_path / "small.zip")
    shutil.rmtree(home)
    shutil.rmtree(tmp_path / "far")
    done = repeated(tmp_path / "small.zip", tmp_path / "there", sinew)
    assert "sinew sobol study.yaml --out results-again --extend" in done
    written = read_study(tmp_path / "there" / "study.yaml")
    assert (written.cohort, written.seed) == ("cohort", 9)
    assert "# ours" in (tmp_path / "there" / "study.yaml").read_text("utf-8")
