"""``sinew submit``: usage, and what SLURM refuses or answers."""

from pathlib import Path

import pytest

from sinew.runner.cluster import batch_system
from tests.tasks.cli.bad_input import FEBIO, write, write_study
from tests.tasks.cluster.stand_in_slurm import SITE, SUBMIT, answer, as_yaml, short_id

USAGES = [
    (("submit", "study.yaml"), "--profile: missing; expected the profile of a cluster"),
    (("submit",), "Missing argument 'STUDY'"),
    (("submit", "study.yaml", "--profile"), "'--profile' requires an argument"),
    ((*SUBMIT, "--fast"), "--fast"),
    ((*SUBMIT, "more"), "unexpected extra argument (more)"),
    ((*SUBMIT, "--seed", "-1"), "'--seed': -1 is not in the range"),
    ((*SUBMIT, "--simulator", "abaqus"), "'--simulator': 'abaqus' is not one of"),
    (("submit", "gone.yaml", *SUBMIT[2:]), "gone.yaml: is not there; expected a study file"),
    (("submit", "cohort", *SUBMIT[2:]), "cohort: is a folder; expected a study file"),
    (("submit", "profile.yaml", *SUBMIT[2:]), "profile.yaml: line 2, mode: unknown key; expected one of name, cohort"),
    (("submit", "study.yaml", "--profile", "study.yaml"), "study.yaml: line 2, cohort: unknown key; expected one of"),
    ((*SUBMIT, "--data", "gone"), "gone: is not there; expected a cohort folder"),
    ((*SUBMIT[:4], "--out", "study.yaml"), "--out study.yaml: study.yaml is a file; expected a folder"),
    ((*SUBMIT[:4], "--out", "study.yaml/out"), "study.yaml is a file; expected a folder"),
    ((*SUBMIT[:4], "--out", "cohort/out"), "--out cohort/out: lies inside the cohort cohort; expected a folder beside"),
    ((*SUBMIT[:4], "--out", "cohort"), "--out cohort: lies inside the cohort cohort; expected a folder beside"),
    ((*SUBMIT[:4], "--out", "my out"), "--out my out: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "o'ut"), "--out o'ut: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", 'o"ut'), '--out o"ut: SLURM\'s scripts cannot hold this path; expected letters'),
    ((*SUBMIT[:4], "--out", "o\nut"), "--out o\\nut: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "out\n"), "--out out\\n: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "out%j"), "--out out%j: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "out;id"), "--out out;id: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "$(id)"), "--out $(id): SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "o\\ut"), "--out o\\ut: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "érgebnis"), "SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "x" * 300), "xxx"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "told"), USAGES, ids=[" ".join(case[0])[:60] for case in USAGES])
def test_usage(refused, arguments, told):
    refused(arguments, told)


@pytest.mark.parametrize(
    "cluster", [{"name": "local", "workers": 1}, "slurm", {"name": "address", "address": "tls://a:1"}]
)
def test_the_profile_comes_before_the_cluster_of_a_study(accepted, cluster):
    write_study("cluster", cluster)
    assert accepted(*SUBMIT).startswith("job 123 leads")


@pytest.mark.parametrize("command", ["run", "sobol"])
@pytest.mark.parametrize("cluster", ["slurm", {"name": "slurm"}])
def test_slurm_without_a_profile(refused, command, cluster):
    write_study("cluster", cluster)
    told = "study.yaml: cluster: slurm without a profile; expected `sinew submit STUDY --profile PROFILE.yaml`"
    refused((command, "study.yaml", "--out", "out"), told)


def test_a_study_says_nothing_to_slurm(refused):
    write_study("cluster", {"name": "slurm", "partition": "cpu"})
    refused(SUBMIT, "study.yaml: line ", "cluster.partition: unknown key; expected one of name")


@pytest.mark.parametrize("field", ["", "modules", "prologue", "directives"])
def test_a_solver_that_only_the_node_has(sinew, refused, field):
    write_study("simulator", FEBIO | {"executable": "no-solver", "template": None})
    profile = {"name": "a"} | ({field: SITE[field]} if field else {})
    write("profile.yaml", as_yaml(profile))
    if field in ("modules", "prologue"):
        assert sinew(*SUBMIT).code == 0
    else:
        refused(SUBMIT, "study.yaml: simulator.executable: 'no-solver' was not found; expected febio4 on the PATH")


@pytest.mark.parametrize("executable", ["no-solver", "/bin/true"])
def test_a_template_is_not_brought_by_a_module(refused, executable):
    write_study("simulator", FEBIO | {"executable": executable, "template": "gone.feb.j2"})
    refused(SUBMIT, "gone.feb.j2: is not there; expected")


@pytest.mark.parametrize("command", ["sbatch", "squeue"])
def test_slurm_is_not_here(refused, monkeypatch, command):
    """A study that was submitted before is looked up by squeue first."""
    if command == "squeue":
        write("out/jobs/jobs.jsonl", '{"time": 1, "job": "5", "event": "submitted"}\n')
    monkeypatch.setenv("PATH", "/nowhere")
    write_study("name", "other")  # nothing of the study has to do with it
    told = f"{command} was not found; run this on a login node, where SLURM is"
    if command == "squeue":
        refused(SUBMIT, told)
    else:
        refused(SUBMIT, told, asked=True)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda path: path.chmod(0o644), "sbatch cannot be run (Permission denied)"),
        (lambda path: path.write_bytes(b"\x7fELF"), "sbatch cannot be run (Exec format error)"),
        (lambda path: path.write_text("#!/nowhere\n"), "sbatch "),
        (lambda path: path.with_name("sbatch-says").write_text("exec /bin/sleep 60"), "sbatch gave no answer within"),
    ],
    ids=["not executable", "no program", "no interpreter", "hangs"],
)  # fmt: skip
def test_sbatch_that_is_broken(refused, monkeypatch, make, told):
    monkeypatch.setattr(batch_system, "COMMAND_TIMEOUT_S", 0.3)
    make(Path("../bin/sbatch"))
    refused(SUBMIT, told, asked=True)


REFUSALS = {
    "Batch job submission failed: Invalid partition name specified": "partition",
    "Batch job submission failed: Requested partition configuration not available now": "partition",
    "Batch job submission failed: User's group not permitted to use this partition": "partition",
    "Batch job submission failed: Invalid account or account/partition combination specified": "account",
    "AssocMaxSubmitJobLimit\nsbatch: error: Batch job submission failed: Job violates accounting/QOS policy "
    "(job submit limit, user's size and/or time limits)": "account",
    "QOSMaxSubmitJobPerUserLimit\nsbatch: error: Batch job submission failed: Job violates accounting/QOS policy "
    "(job submit limit, user's size and/or time limits)": "qos",
    "Batch job submission failed: Invalid qos specification": "qos",
    "Batch job submission failed: Invalid feature specification": "constraint",
    "Batch job submission failed: Requested reservation is invalid": "directives",
    "Memory specification can not be satisfied": "workers.memory",
    "Batch job submission failed: Requested time limit is invalid (missing or exceeds some limit)": "workers.walltime",
    "CPU count per node can not be satisfied": "workers.cores",
    "Batch job submission failed: More processors requested than permitted": "workers.cores",
    "Batch job submission failed: Requested node configuration is not available": "workers.cores",
    "something that nobody has seen before": "workers",
    "": "workers",
    "\x1b[31mInvalid partition\x07\r\x1b[2J": "partition",
    "a\n" * 500 + "Invalid qos specification": "qos",
}


@pytest.mark.parametrize(("words", "field"), REFUSALS.items(), ids=short_id)
def test_slurm_refuses(refused, words, field):
    write("../bin/words", f"sbatch: error: {words}\n" if words else "")
    answer("sbatch", "/bin/cat ../bin/words >&2; exit 1")
    said = refused(SUBMIT, f"profile.yaml: {field}: SLURM refuses the job (", "nothing was submitted", asked=True)
    assert len(said) < 1000


def test_slurm_refuses_the_memory_without_saying_so(refused):
    said = "case $* in *--mem=1*) exit 0;; esac; echo 'Requested node configuration is not available' >&2; exit 1"
    answer("sbatch", said)
    refused(SUBMIT, "profile.yaml: workers.memory: SLURM refuses the job (", asked=True)


def test_slurm_refuses_for_a_policy_that_it_does_not_name(refused):
    """SLURM's words for every limit of an account; they only happen to hold the words time limit."""
    words = "Job violates accounting/QOS policy (job submit limit, user's size and/or time limits)"
    answer("sbatch", f'echo "sbatch: error: Batch job submission failed: {words}" >&2; exit 1')
    assert "workers.walltime" not in refused(SUBMIT, "SLURM refuses the job (", asked=True)


@pytest.mark.parametrize(
    "words",
    [
        "Unable to contact slurm controller (connect failure)",
        "Batch job submission failed: Socket timed out on send/recv operation",
        "Zero Bytes were transmitted or received: communication failure",
        "connect: Connection refused",
    ],
)
def test_the_controller_does_not_answer(refused, words):
    answer("sbatch", f"echo 'sbatch: error: {words}' >&2; exit 1")
    refused(SUBMIT, "SLURM's controller does not answer (", "try again when it is back", asked=True)


def test_a_refusal_leaves_nothing_behind(refused):
    answer("sbatch", "echo 'sbatch: error: Invalid qos specification' >&2; exit 1")
    refused(SUBMIT, "profile.yaml: qos: ", asked=True)
    assert not Path("out").exists()


@pytest.mark.parametrize("answered", ["", "Submitted batch job 123", "12x", "\x1b[31m", "-1"])
def test_an_answer_without_a_number(sinew, answered):
    """sbatch took the job, so nobody may be told that nothing was submitted."""
    write("../bin/words", answered)
    answer("sbatch", "case $* in *--parsable*) /bin/cat ../bin/words;; esac")
    said = sinew(*SUBMIT)
    assert said.code == 2
    assert said.err.count("\n") == 1
    assert "nothing was submitted" not in said.err


def test_the_number_of_a_job_in_a_federation(accepted):
    answer("sbatch", "echo '123;north'")
    assert accepted(*SUBMIT).startswith("job 123 leads")


@pytest.mark.parametrize("command", [SUBMIT, ("cancel", "out"), ("doctor", "study.yaml", "--out", "out")], ids=str)
@pytest.mark.parametrize("place", ["jobs", "jobs/jobs.jsonl", "jobs/job.sh"])
def test_nothing_is_written_through_a_link_in_a_result_folder(refused, command, place):
    Path("elsewhere").mkdir()
    Path("elsewhere", "mine").write_text("mine")
    link = Path("out", place)
    link.parent.mkdir(parents=True)
    Path("out", "store.zarr").mkdir()
    link.symlink_to(Path("elsewhere").absolute() if place == "jobs" else Path("elsewhere", "mine").absolute())
    refused(command, f"out/{place}: is a link; a result folder holds files and folders only, remove it")
    assert [(path.name, path.read_text()) for path in Path("elsewhere").iterdir()] == [("mine", "mine")]


def test_no_line_break_of_a_path_reaches_a_job_script(refused):
    """Batch systems look for their options in every line, also in those of a quoted path."""
    folder = Path("evil\n#$ -S evil\nz")
    folder.mkdir()
    (folder / "study.yaml").write_bytes(Path("study.yaml").read_bytes())
    command = ("submit", str(folder / "study.yaml"), "--data", "cohort", "--profile", "profile.yaml", "--dry-run")
    refused(command, "has line breaks or other control characters; expected a path without them")
