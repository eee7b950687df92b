"""A study from somebody else runs no program, and opens no door, that its user did not confirm."""

import os
import stat
import sys
from pathlib import Path

import numpy as np
import pytest

from sinew.runner.cluster.client import Address
from sinew.runner.cluster.local import Local
from sinew.runner.errors import BadInput
from sinew.tasks.cli.main import main
from sinew.tasks.cluster.spec import cluster_of, cluster_request
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model import Model
from sinew.tasks.simulate.build import febio_of, simulator_of
from sinew.tasks.study.resources import resource
from sinew.tasks.study.study import read_study
from sinew.tasks.study.trust import Request, allow, is_allowed
from tests.trusting import trusted

EVIL = "#!/bin/sh\ntouch {folder}/ran\necho version 4.11.0\n"
# a FEBio template whose first lines are a comment to XML and commands to a shell
HIDDEN = "<!--\ntouch {folder}/ran\nexit\n-->\n"


@pytest.fixture
def study(tmp_path, monkeypatch):
    """Writes a study with these settings, beside an evil program and an evil template, into the current folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    for name in ("evil.sh", "febio4"):
        program = tmp_path / name
        program.write_text(EVIL.format(folder=tmp_path))
        program.chmod(0o755)
    text = resource("templates/tendon.feb.j2").read_text()
    (tmp_path / "evil.feb.j2").write_text(HIDDEN.format(folder=tmp_path) + text.partition("\n")[2])
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    write_cohort(tmp_path / "cohort", specimens[:1], truth)

    def write(settings: str) -> Path:
        path = tmp_path / "study.yaml"
        path.write_text(f"name: evil\ncohort: cohort\nsobol: {{base_samples: 2}}\n{settings}\n")
        return path

    return write


def ends(monkeypatch, *arguments) -> int:
    monkeypatch.setattr(sys, "argv", ["sinew", *map(str, arguments)])
    try:
        main()
    except SystemExit as ended:
        return int(ended.code or 0)
    return 0


SOLVERS = ["simulator: {name: febio, executable: ./evil.sh}", "simulator: {name: febio, executable: /bin/sh}"]


@pytest.mark.parametrize("settings", SOLVERS)
@pytest.mark.parametrize("command", ["run", "sobol", "discover", "doctor", "simulate", "submit"])
def test_no_command_runs_a_program_that_a_study_brings(study, tmp_path, monkeypatch, capsys, settings, command):
    path = study(settings)
    (tmp_path / "rows.csv").write_text("E_f\n200\n")
    (tmp_path / "profile.yaml").write_text("name: here\n")
    more = {"simulate": ("--parameters", "rows.csv"), "submit": ("--profile", "profile.yaml", "--dry-run")}
    assert ends(monkeypatch, command, path, "--out", "out", *more.get(command, ())) == 2
    out, err = capsys.readouterr()
    said = out if command == "doctor" else err  # which goes on with its other checks
    assert "study.yaml: simulator.executable: " in said
    assert f"or your consent: `sinew trust {path}`" in said
    assert err.count("\n") == 1
    assert not (tmp_path / "ran").exists()


def test_a_template_that_a_shell_understands_is_not_given_to_one(study, tmp_path):
    path = study("simulator: {name: febio, executable: sh, template: evil.feb.j2}")
    with pytest.raises(BadInput, match=r"simulator\.executable: 'sh' would run on this machine"):
        simulator_of(read_study(path), None, tmp_path / "attempts")


def test_discovery_with_the_embedded_simulator_does_not_ask_an_evil_solver_for_its_version(study, tmp_path):
    read = read_study(study(SOLVERS[0]))
    simulator_of(read, "uniaxial", tmp_path / "attempts")
    with pytest.raises(BadInput, match=r"simulator\.executable"):
        febio_of(read, (), tmp_path / "attempts")
    assert not (tmp_path / "ran").exists()


def test_febio4_by_its_plain_name_needs_no_consent(study, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    read = read_study(study("simulator: {name: febio}"))
    assert simulator_of(read, None, tmp_path / "attempts").version == "4.11.0"


def test_febio4_that_a_path_finds_in_the_current_folder_needs_consent(study, tmp_path, monkeypatch):
    """With a PATH such as ``.:/bin``, the plain name may be a program that came with the study."""
    monkeypatch.setenv("PATH", f".{os.pathsep}{os.environ['PATH']}")
    path = study("simulator: {name: febio}")
    with pytest.raises(BadInput, match="'febio4' would run on this machine"):
        simulator_of(read_study(path), None, tmp_path / "attempts")
    assert not (tmp_path / "ran").exists()


def test_the_user_s_own_solver_needs_no_consent_and_replaces_the_study_s(study, tmp_path):
    path = study("simulator: {name: febio, executable: /bin/sh}")
    for given in ("./evil.sh", str(tmp_path / "evil.sh")):
        solver = simulator_of(read_study(path, solver=given), None, tmp_path / "attempts")
        assert solver.executable == str(tmp_path / "evil.sh")
    with pytest.raises(BadInput, match="--solver: 'gone' was not found"):
        simulator_of(read_study(path, solver="gone"), None, tmp_path / "attempts")
    plain = read_study(study(""), solver="./evil.sh")
    assert simulator_of(plain, "febio", tmp_path / "attempts").executable == str(tmp_path / "evil.sh")


def test_consent_holds_until_the_study_the_template_or_the_program_changes(study, tmp_path, monkeypatch, capsys):
    path = study("simulator: {name: febio, executable: ./evil.sh, template: evil.feb.j2}")

    def refused() -> bool:
        try:
            simulator_of(read_study(path), None, tmp_path / "attempts")
        except BadInput as error:
            assert "sinew trust" in str(error)
            return True
        return False

    def changed(file: str, change: str) -> bool:
        before = (tmp_path / file).read_text()
        (tmp_path / file).write_text(before + change)
        asked = refused()
        (tmp_path / file).write_text(before)
        return asked

    assert refused()
    assert ends(monkeypatch, "trust", path) == 0
    said = capsys.readouterr().out
    assert "allowed: simulator.executable: './evil.sh' would run on this machine\n" in said
    assert f"  {tmp_path / 'evil.sh'} may read or run other files: a change of these is not asked about again\n" in said
    assert not (tmp_path / "ran").exists(), "what is allowed need not run now"
    assert not refused()
    assert changed("study.yaml", "retries: 0\n")
    assert changed("evil.sh", "# more\n")
    assert changed("evil.feb.j2", "<!-- more -->\n")
    assert not refused()
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    path = path.rename(moved / "study.yaml")
    (tmp_path / "evil.feb.j2").rename(moved / "evil.feb.j2")
    assert refused()


def test_a_study_that_asks_for_nothing_is_told_so(study, monkeypatch, capsys):
    path = study("")
    assert ends(monkeypatch, "trust", path) == 0
    assert capsys.readouterr().out == f"{path} asks for nothing that needs your consent\n"


@pytest.mark.parametrize(
    ("cluster", "words", "spec"),
    [
        ("{name: address, address: 'tcp://127.0.0.1:9'}", r"cluster\.address: work would be", Address("tcp://127.0.0.1:9")),
        ("{name: local, workers: 2, tls: false}", r"cluster\.tls: false: any user of", Local(2, tls=False)),
    ],
)  # fmt: skip
def test_schedulers_and_open_doors_need_consent(study, cluster, words, spec):
    path = study(f"cluster: {cluster}")
    with pytest.raises(BadInput, match=words):
        cluster_of(read_study(path))
    assert cluster_of(read_study(path), scheduler="tls://here:1") == Address("tls://here:1")
    assert cluster_of(read_study(trusted(path))) == spec


def test_a_scheduler_s_address_is_checked(study):
    with pytest.raises(BadInput, match="--scheduler: 'http://x:1'; expected tls://HOST:PORT"):
        cluster_of(read_study(study("")), scheduler="http://x:1")


def test_consent_that_somebody_else_wrote_does_not_count(study, tmp_path):
    request = Request(study(""), "", "field", "words", "instead")
    folder = tmp_path / "state" / "sinew" / "trusted"
    allow([request])
    assert is_allowed(request)
    kept = folder / request.key
    assert folder.stat().st_mode & 0o077 == 0
    kept.rename(tmp_path / "kept")
    kept.symlink_to(tmp_path / "kept")
    assert not is_allowed(request), "a link"
    kept.unlink()
    kept.mkdir()
    assert not is_allowed(request), "a folder"
    if os.geteuid() == 0:
        kept.rmdir()
        kept.write_text("")
        os.chown(kept, 1, 1)
        assert not is_allowed(request), "another user's"


def test_consent_is_for_what_was_read_and_not_for_what_the_file_holds_since(study):
    """Its author may replace a study while `sinew trust` looks at a slow template."""
    path = study("cluster: {name: address, address: 'tls://good:9'}")
    shown = cluster_request(read_study(path))
    study("cluster: {name: address, address: 'tls://evil:9'}")
    allow([shown])
    with pytest.raises(BadInput, match="tls://evil:9"):
        cluster_of(read_study(path))
    study("cluster: {name: address, address: 'tls://good:9'}")
    assert cluster_of(read_study(path)) == Address("tls://good:9")


def test_a_program_that_is_replaced_after_it_was_confirmed_is_not_run(study, tmp_path):
    path = trusted(study("simulator: {name: febio, executable: ./evil.sh}"))
    solver = simulator_of(read_study(path), None, tmp_path / "attempts")
    (tmp_path / "ran").unlink()
    specimens, _ = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    curve, rows = specimens[0].curves[0], Model().reference[np.newaxis]
    solver.simulate(Model(), specimens[0], curve.protocol, rows)
    assert (tmp_path / "ran").exists()
    (tmp_path / "ran").unlink()
    other = tmp_path / "other.sh"
    other.write_text((tmp_path / "evil.sh").read_text() + "# another one\n")
    other.chmod(0o755)
    other.replace(tmp_path / "evil.sh")
    with pytest.raises(PermissionError, match="not the program that you confirmed"):
        solver.simulate(Model(), specimens[0], curve.protocol, rows)
    assert not (tmp_path / "ran").exists()


def test_consent_in_a_folder_that_others_can_write_to_does_not_count(study, tmp_path):
    """They could give a confirmation of the user's own the name of another one."""
    request, other = (Request(study(""), "", field, "words", "instead") for field in ("field", "other"))
    allow([request])
    folder = tmp_path / "state" / "sinew" / "trusted"
    assert stat.S_IMODE(folder.parent.stat().st_mode) == stat.S_IMODE(folder.stat().st_mode) == 0o700
    (folder / request.key).rename(folder / other.key)
    assert not is_allowed(other), "it is of another request"
    (folder / other.key).rename(folder / request.key)
    assert is_allowed(request)
    for one in (folder, folder.parent):
        one.chmod(0o770)
        assert not is_allowed(request)
        with pytest.raises(PermissionError):
            allow([request])
        one.chmod(0o700)
        assert is_allowed(request)


def test_a_path_of_any_bytes_has_a_key_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    requests = [Request(tmp_path / name, "text", "field", "words", "instead") for name in ("a\udcff", "a\udcfe")]
    assert len({request.key for request in requests}) == 2
    allow(requests[:1])
    assert [is_allowed(request) for request in requests] == [True, False]


@pytest.mark.parametrize("kind", ["pipe", "link"])
def test_what_stands_in_the_place_of_a_consent_is_replaced(tmp_path, monkeypatch, kind):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    request = Request(tmp_path / "study.yaml", "text", "field", "words", "instead")
    allow([request])
    (there,) = (tmp_path / "state" / "sinew" / "trusted").iterdir()
    there.unlink()
    (tmp_path / "mine").write_text("mine")
    os.mkfifo(there) if kind == "pipe" else there.symlink_to(tmp_path / "mine")
    assert not is_allowed(request)
    allow([request])
    assert is_allowed(request)
    assert (tmp_path / "mine").read_text() == "mine"


@pytest.mark.parametrize("mode", ["folder for all", "file for a group", "of another user"])
def test_a_program_that_others_may_replace_cannot_be_confirmed(study, tmp_path, monkeypatch, capsys, mode):
    path = study("simulator: {name: febio, executable: ./evil.sh}")
    program = tmp_path / "evil.sh"
    if mode == "folder for all":
        tmp_path.chmod(0o777)
    elif mode == "file for a group":
        program.chmod(0o775)
        monkeypatch.setattr("sinew.runner.files._is_private", lambda group: False)
    else:
        real = os.lstat
        fields = [*real(program)]
        fields[4] = os.geteuid() + 1
        monkeypatch.setattr(
            os, "lstat", lambda file, **k: os.stat_result(fields) if file == program else real(file, **k)
        )
    assert ends(monkeypatch, "trust", path) == 2
    told = "to another user; expected" if mode == "of another user" else "who may write there; expected"
    assert told in capsys.readouterr().err
    assert not (tmp_path / "ran").exists()


def test_a_confirmed_program_is_looked_up_once_and_compared_before_its_version_is_asked(study, tmp_path, monkeypatch):
    path = study("simulator: {name: febio, executable: ./link}")
    good = tmp_path / "good.sh"
    good.write_text("#!/bin/sh\necho version 4.11.0\n")
    good.chmod(0o755)
    link = tmp_path / "link"
    link.symlink_to(good)
    trusted(path)

    def require(request):
        link.unlink()
        link.symlink_to(tmp_path / "evil.sh")

    monkeypatch.setattr("sinew.tasks.simulate.febio.settings.require", require)
    assert simulator_of(read_study(path), None, tmp_path / "attempts").executable == str(good)
    link.unlink()
    link.symlink_to(good)
    monkeypatch.setattr(
        "sinew.tasks.simulate.febio.settings.require",
        lambda request: good.write_text((tmp_path / "evil.sh").read_text()),
    )
    with pytest.raises(BadInput, match=r"cannot be run .*not the program that you confirmed"):
        simulator_of(read_study(path), None, tmp_path / "attempts")
    assert not (tmp_path / "ran").exists()
