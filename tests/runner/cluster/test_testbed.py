"""The SLURM on one machine that other tests use."""

import socket
from collections.abc import Iterator

import pytest

from tests.batch.plugin import load_testbed

pytestmark = pytest.mark.slurm


@pytest.fixture
def taken() -> Iterator[int]:
    with socket.create_server(("0.0.0.0", 0)) as server:
        yield server.getsockname()[1]


@pytest.mark.parametrize("place", [0, 2], ids=["controller", "node"])
def test_a_port_that_another_program_took_is_replaced(tmp_path, monkeypatch, taken, place):
    """Between the choice of a port and its use, another program may take it."""
    module = load_testbed()
    choose, tries = module._free_ports, []

    def ports(count: int) -> list[int]:
        tries.append(choose(count))
        if len(tries) == 1:
            tries[0][place] = taken
        return tries[-1]

    monkeypatch.setattr(module, "_free_ports", ports)
    testbed = module.start(tmp_path / "slurm", nodes=2, cpus=1)
    try:
        assert testbed.run("srun", "-N2", "hostname").split() == [socket.gethostname()] * 2
        assert len(tries) == 2
    finally:
        module.stop(testbed)
