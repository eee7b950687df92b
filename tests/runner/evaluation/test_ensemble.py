"""Batches on a real local cluster: failures as data, retries, dead workers, and the same bytes whoever computes."""

import asyncio
import gc
import http.client
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from distributed import Client

from sinew.runner.cluster.client import Address, open_client
from sinew.runner.cluster.local import Local
from sinew.runner.errors import ClusterError, StoreError
from sinew.runner.evaluation import on_cluster
from sinew.runner.evaluation.ensemble import evaluate, failures
from sinew.runner.evaluation.policy import Policy
from sinew.runner.store.schema import STATUSES
from sinew.runner.store.store import Store
from tests.runner.evaluations import Quick, table_spec
from tests.runner.stores import contents, some


@pytest.fixture(scope="module")
def client():
    with open_client(Local(2)) as client:
        yield client


def run(client, table, evaluation, parameters, report=None, policy=None) -> np.ndarray:
    rows = table.plan(parameters)
    evaluate(client, table, evaluation, rows, report, policy or Policy())
    return rows


def with_bad(count: int, *bad: int) -> np.ndarray:
    parameters = some(count)
    parameters[list(bad), 0] *= -1
    return parameters


def test_results_do_not_depend_on_workers_or_batches(tmp_path, client):
    parameters = some(5000)
    for name, get, policy in (
        ("two", lambda: client, Policy()),
        ("here", lambda: None, Policy(batch_s=0.001)),
        ("small", lambda: client, Policy(batch_s=0.01, multiple=16)),
    ):
        with Store.writing(tmp_path / name, "study") as store:
            run(get, store.table(table_spec()), Quick(), parameters, policy=policy)
    assert contents(tmp_path / "two") == contents(tmp_path / "here") == contents(tmp_path / "small")


def test_a_cluster_is_not_asked_for_when_all_is_known(tmp_path):
    def never():
        raise AssertionError("no cluster is needed")

    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        run(lambda: None, table, Quick(), some(100))
        assert np.array_equal(run(never, table, Quick(), some(100)), np.arange(100))


@pytest.mark.parametrize(
    ("bad", "status", "message", "attempts"),
    [
        ("raise", "crashed", "ArithmeticError: no such tissue", 2),
        ("nan", "bad_output", "not finite", 2),
        ("crashed", "crashed", "it broke", 2),
        ("diverged", "diverged", "it broke", 1),
    ],
)
def test_failed_rows_are_data(tmp_path, client, bad, status, message, attempts):
    parameters = with_bad(300, 7, 250)
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = run(lambda: client, table, Quick(bad=bad), parameters, policy=Policy(retries=1))
        assert failures(table, rows) == {status: 2}
        assert [STATUSES[s] for s in table.status[rows[[7, 250]]]] == [status, status]
        assert message in str(table.read("message", rows[[7]])[0])
        assert table.read("attempts", rows)[[6, 7]].tolist() == [1, attempts]
        force = table.read("force", rows)
        assert np.isnan(force[[7, 250]]).all()
        assert np.isfinite(np.delete(force, [7, 250], axis=0)).all()


def test_a_row_that_kills_its_worker_is_found_and_its_neighbours_are_not_blamed(tmp_path, client):
    parameters = with_bad(40, 11)
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = run(lambda: client, table, Quick(bad="kill"), parameters, policy=Policy(multiple=10))
        assert failures(table, rows) == {"crashed": 1}
        assert table.status[rows[11]] > 0
        assert "its process died while it evaluated this row alone (SIGKILL)" in str(
            table.read("message", rows[[11]])[0]
        )


@pytest.mark.parametrize(("failures_first", "goes_on"), [(2, True), (9, False)])
def test_a_worker_that_dies_while_it_is_met_is_asked_again(tmp_path, client, monkeypatch, failures_first, goes_on):
    """A handshake over TLS that its other end leaves is a ValueError, where other lost messages are an OSError."""
    errors: list[Exception] = [ValueError("not idle"), OSError("closed")] * 5
    met = Client.register_plugin

    def meet(self, plugin, name=None):
        if len(errors) > 10 - failures_first:
            raise errors.pop()
        return met(self, plugin, name=name)

    monkeypatch.setattr(Client, "register_plugin", meet)
    monkeypatch.setattr(on_cluster, "ASK_AGAIN_S", 0.0)
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        if goes_on:
            run(lambda: client, table, Quick(), some(20))
            assert not table.status.any()
        else:
            with pytest.raises(ClusterError, match=r"do not answer \(closed\); run the same command again"):
                run(lambda: client, table, Quick(), some(20))


def test_a_full_disk_stops_the_run_and_fails_no_row(tmp_path, client):
    parameters = with_bad(3000, 2900)
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        with pytest.raises(StoreError, match=r"no space left on the disk; free some"):
            run(lambda: client, table, Quick(bad="disk"), parameters)
        rows = run(lambda: client, table, Quick(), parameters)
        assert not table.status[rows].any()


def test_failed_rows_can_be_opened_again(tmp_path):
    parameters = with_bad(30, 3)
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = run(lambda: None, table, Quick(bad="diverged"), parameters)
        table.reopen(rows)
        assert table.pending(rows).tolist() == [3]
        run(lambda: None, table, Quick(), parameters)
        assert not table.status.any()


def test_progress_counts_every_row_once(tmp_path, client):
    said: list[tuple[int, int]] = []
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        run(lambda: client, table, Quick(), some(100))
        parameters = np.concatenate([some(100), with_bad(50, 1)[:50] + 2])
        run(lambda: client, table, Quick(), parameters, lambda done, failed, running: said.append((done, failed)))
    assert said[-1] == (150, 0)
    assert [done for done, _ in said] == sorted(done for done, _ in said)


def test_traffic_is_encrypted_and_local(client):
    assert client.scheduler_info()["address"].startswith("tls://127.0.0.1:")


def test_a_stranger_without_the_certificate_is_refused(client):
    from distributed import Client

    with pytest.raises((OSError, TypeError, ValueError, RuntimeError)):
        Client(client.scheduler_info()["address"], timeout="3 s", set_as_default=False)
    gc.collect()  # distributed closes a client that did not start; in a loop that starts this would wait for itself


async def _identity(address: str, security: Any) -> Any:
    """What a process of a cluster says to somebody who asks who it is."""
    from distributed.core import connect

    comm = await connect(address, timeout=3, **security.get_connection_args("client"))
    try:
        await comm.write({"op": "identity", "reply": True})
        return await asyncio.wait_for(comm.read(), 5)
    finally:
        comm.abort()


def test_a_certificate_of_one_s_own_opens_no_process_of_a_run(client):
    """Scheduler, workers and their nannies ask for the run's own certificate."""
    from distributed.security import Security

    info = client.scheduler_info()
    nannies = [worker["nanny"] for worker in info["workers"].values()]
    addresses = [info["address"], *info["workers"], *nannies]
    assert len(addresses) >= 3
    assert all(address.startswith("tls://127.0.0.1:") for address in addresses)
    for address in addresses:
        with pytest.raises(OSError, match=r"(?i)ssl|tls|cert|closed|timed out"):
            asyncio.run(_identity(address, Security.temporary()))
        assert asyncio.run(_identity(address, client.security))["id"], "with the run's own, it answers"


def test_the_dashboard_shows_but_does_nothing(client):
    """It listens on this machine only; it has no page that leads to other ports or that changes anything."""
    port = client.scheduler_info()["services"]["dashboard"]

    def code(page: str) -> int:
        with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=30)) as connection:
            connection.request("GET", f"/{page}")
            with connection.getresponse() as response:
                return response.status

    assert code("info/main/workers.html") == 200
    assert [page for page in ("proxy/22/127.0.0.1/", "api/v1/retire_workers") if code(page) != 404] == []


def test_an_address_without_a_scheduler_is_one_clear_line(monkeypatch):
    monkeypatch.setattr("sinew.runner.cluster.client.ADDRESS_S", 0.5)
    expected = pytest.raises(ClusterError, match=r"cluster\.address: no scheduler at tcp://127\.0\.0\.1:9")
    with expected, open_client(Address("tcp://127.0.0.1:9")):
        pass
