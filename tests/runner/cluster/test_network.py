"""The certificate of a run in files: nobody but its owner reads the key."""

import os
import ssl

import pytest

from sinew.runner.cluster.network import private_folder, shared_certificate
from sinew.runner.errors import ClusterError


@pytest.fixture
def _open_to_all():
    before = os.umask(0)
    yield
    os.umask(before)


@pytest.mark.usefixtures("_open_to_all")
def test_the_key_of_a_run_is_for_its_owner_alone(tmp_path):
    folder = tmp_path / "jobs" / "certificate"
    security = shared_certificate(folder, create=True)
    assert folder.stat().st_mode & 0o777 == 0o700
    assert {path.name: path.stat().st_mode & 0o777 for path in folder.iterdir()} == dict.fromkeys(
        ("certificate.pem", "key.pem"), 0o600
    )
    assert security.require_encryption
    for role in ("client", "scheduler", "worker"):
        context = security.get_connection_args(role)["ssl_context"]
        assert context.verify_mode == ssl.CERT_REQUIRED, role


def test_every_run_has_another_key(tmp_path):
    keys = set()
    for _ in range(2):
        shared_certificate(tmp_path / "certificate", create=True)
        keys.add((tmp_path / "certificate" / "key.pem").read_bytes())
    assert len(keys) == 2


def test_a_folder_that_cannot_be_made_afresh_is_refused(tmp_path):
    """Another user may have put a link there, which is not followed."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "folder").symlink_to(tmp_path / "mine")
    with pytest.raises(ClusterError, match="folder: File exists"):
        private_folder(tmp_path / "folder")
