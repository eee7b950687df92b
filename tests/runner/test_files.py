"""Only regular files of a bounded size are read, whatever stands in their place."""

import grp
import os
import pwd
import socket
import subprocess
import tracemalloc
from pathlib import Path

import pytest

from sinew.runner import files
from sinew.runner.files import (
    DEEPEST,
    NotReadable,
    _is_private,
    append_file,
    new_file,
    own_folder,
    parse_json,
    read_regular,
    refuse_open_way,
    refuse_replaceable,
    remove_folder,
    strange_entry,
    temporary_folder,
    write_whole,
)


def pipe(path):
    os.mkfifo(path)


def unix_socket(path):
    server = socket.socket(socket.AF_UNIX)
    server.bind(str(path))
    server.close()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (pipe, "a named pipe"),
        (lambda path: path.mkdir(), "a folder"),
        (unix_socket, "a socket"),
        (lambda path: path.symlink_to("/dev/zero"), "a link"),
        (lambda path: path.symlink_to(path), "a link"),
        (lambda path: path.symlink_to("/etc/hostname"), "a link"),
    ],
)
def test_what_is_no_regular_file_is_named(tmp_path, make, words):
    make(tmp_path / "odd")
    with pytest.raises(NotReadable, match=words):
        read_regular(tmp_path / "odd", 100)


@pytest.mark.parametrize(("device", "words"), [("/dev/zero", "a device"), ("/dev/urandom", "a device")])
def test_devices_are_not_read_where_links_are_followed_either(tmp_path, device, words):
    (tmp_path / "odd").symlink_to(device)
    with pytest.raises(NotReadable, match=words):
        read_regular(tmp_path / "odd", 100, follow=True)


def test_a_link_that_may_be_followed_is_read(tmp_path):
    (tmp_path / "file").write_bytes(b"content")
    (tmp_path / "link").symlink_to("file")
    assert read_regular(tmp_path / "link", 7, follow=True) == b"content"


def test_the_size_is_bounded(tmp_path):
    (tmp_path / "file").write_bytes(b"content")
    assert read_regular(tmp_path / "file", 7) == b"content"
    with pytest.raises(NotReadable, match="7 bytes, more than 6"):
        read_regular(tmp_path / "file", 6)
    with pytest.raises(NotReadable, match="more than 3 bytes"):  # its size is said to be 0
        read_regular(tmp_path.joinpath("/proc/self/status"), 3)


def test_a_file_that_does_not_say_its_size_is_read_within_the_bound(monkeypatch):
    monkeypatch.setattr(files, "PIECE", 16)
    content = Path("/proc/self/limits").read_bytes()
    assert read_regular(Path("/proc/self/limits"), len(content)) == content
    with pytest.raises(NotReadable, match=f"more than {len(content) - 1:,} bytes"):
        read_regular(Path("/proc/self/limits"), len(content) - 1)


def test_a_large_bound_takes_no_memory(tmp_path):
    (tmp_path / "a").write_text("short")
    tracemalloc.start()
    assert read_regular(tmp_path / "a", 2**30) == b"short"
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 2**22


def test_the_end_of_a_large_file_can_be_read(tmp_path):
    (tmp_path / "file").write_bytes(b"0123456789")
    assert read_regular(tmp_path / "file", 0, last=4) == b"6789"
    assert read_regular(tmp_path / "file", 0, last=40) == b"0123456789"


def test_a_file_that_is_missing_is_said_to_be_missing(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_regular(tmp_path / "gone", 10)
    (tmp_path / "link").symlink_to("gone")
    with pytest.raises(FileNotFoundError):
        read_regular(tmp_path / "link", 10, follow=True)


@pytest.mark.parametrize(
    ("make", "words"),
    [(pipe, "a named pipe"), (lambda path: path.symlink_to("/etc"), "a link"), (unix_socket, "a socket")],
)
def test_what_is_neither_file_nor_folder_is_found_at_any_depth(tmp_path, make, words):
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "file").touch()
    assert strange_entry(tmp_path) is None
    make(tmp_path / "a" / "b" / "odd")
    assert strange_entry(tmp_path) == (tmp_path / "a" / "b" / "odd", words)
    assert strange_entry(tmp_path, closed=["a"]) is None
    assert strange_entry(tmp_path, closed=["b"]) is not None, "a name directly below the folder"
    make(tmp_path / "attempts")
    assert strange_entry(tmp_path, closed=["a", "attempts"]) == (tmp_path / "attempts", words)


def test_folders_inside_each_other_are_found_before_python_gives_up(tmp_path):
    (tmp_path / "a" / Path(*["d"] * (DEEPEST - 1))).mkdir(parents=True)
    assert strange_entry(tmp_path) is None
    (tmp_path / "a" / Path(*["d"] * DEEPEST)).mkdir()
    assert strange_entry(tmp_path) == (
        tmp_path / "a" / Path(*["d"] * 7),
        "a chain of nested folders, more than 32 deep",
    )
    assert strange_entry(tmp_path, closed=["a"]) is None


def test_the_folder_itself_may_be_a_link_and_a_link_that_goes_round_ends(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    assert strange_entry(tmp_path / "link") is None
    (tmp_path / "real" / "again").symlink_to("..")
    assert strange_entry(tmp_path / "link") == (tmp_path / "link" / "again", "a link")


@pytest.mark.parametrize("kind", ["link", "open to others", "of another user", "a file"])
def test_a_folder_that_others_can_write_to_is_refused(tmp_path, monkeypatch, kind):
    """In a folder that all users share, another user may have made it first."""
    folder = tmp_path / "folder"
    if kind == "link":
        folder.symlink_to(tmp_path)
    elif kind == "a file":
        folder.write_text("")
    else:
        folder.mkdir()
        folder.chmod(0o777 if kind == "open to others" else 0o755)
    if kind == "of another user":
        other = folder.stat().st_uid + 1
        monkeypatch.setattr(os, "geteuid", lambda: other)
    with pytest.raises(PermissionError, match="no folder that only you can write to"):
        own_folder(folder)


def test_no_folder_is_used_which_any_user_could_replace(tmp_path):
    """Who owns a folder, or may write to it where it has no sticky bit, can rename what is inside."""
    shared, way = tmp_path / "shared", tmp_path / "shared" / "way"
    way.mkdir(parents=True)
    refuse_open_way(way)
    shared.chmod(0o777)
    with pytest.raises(PermissionError, match="all users may rename"):
        refuse_open_way(way)
    shared.chmod(0o1777)
    refuse_open_way(way)


@pytest.mark.parametrize("kind", ["folder", "link"])
def test_no_way_leads_through_what_another_user_has_made_for_all(tmp_path, monkeypatch, kind):
    shared, mine = tmp_path / "shared", tmp_path / "mine"
    shared.mkdir()
    mine.mkdir()
    way = shared / "way"
    way.symlink_to(mine) if kind == "link" else way.mkdir()
    refuse_open_way(way)
    real, theirs = os.lstat, way
    fields = [*real(way)]
    fields[4] = os.geteuid() + 1
    monkeypatch.setattr(os, "lstat", lambda path: os.stat_result(fields) if Path(path) == theirs else real(path))
    refuse_open_way(way)  # in a folder of one's own
    shared.chmod(0o1777)
    with pytest.raises(PermissionError, match="belongs to another user, where all may write"):
        refuse_open_way(way)


def test_the_temporary_folder_is_the_user_s_own(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    before = os.umask(0)
    try:
        folder = temporary_folder()
    finally:
        os.umask(before)
    assert folder.parent == tmp_path
    assert folder.stat().st_mode & 0o777 == 0o700
    assert temporary_folder() == folder, "it is there already"


def test_a_folder_is_removed_however_deep_it_is(tmp_path, monkeypatch):
    (tmp_path / "a").mkdir()
    (tmp_path / "other").mkdir()
    (tmp_path / "a" / "link").symlink_to(tmp_path / "other")
    with monkeypatch.context() as patch:
        patch.chdir(tmp_path / "a")
        for _ in range(3000):
            os.mkdir("d")  # noqa: PTH102 - the path is longer than the system takes
            os.chdir("d")
    remove_folder(tmp_path / "a")
    assert [path.name for path in tmp_path.iterdir()] == ["other"]
    (tmp_path / "link").symlink_to(tmp_path / "other")
    remove_folder(tmp_path / "link")
    assert len(list(tmp_path.iterdir())) == 2, "a link is no folder, and is not followed"
    remove_folder(tmp_path / "gone")


def test_a_file_that_has_another_name_elsewhere_keeps_its_mode(tmp_path, monkeypatch):
    monkeypatch.setattr("sinew.runner.files.shutil.rmtree", lambda *_, **__: None)  # as where folders are closed
    (tmp_path / "mine").write_text("kept")
    (tmp_path / "mine").chmod(0o400)
    closed = tmp_path / "a" / "closed" / "inner"
    closed.mkdir(parents=True)
    os.link(tmp_path / "mine", closed / "link")
    closed.chmod(0o500)
    closed.parent.chmod(0o000)
    remove_folder(tmp_path / "a")
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    assert (tmp_path / "mine").stat().st_mode & 0o777 == 0o400


@pytest.mark.parametrize(
    "text", [b"[" + b"[]," * 2**20 + b"[]]", b"[" + b"{}," * 2**20 + b"1]", b"[" + b"1," * (2**23 + 1) + b"1]"]
)
def test_json_that_would_fill_the_memory_is_refused_unparsed(text, monkeypatch):
    monkeypatch.setattr("sinew.runner.files.json.loads", lambda _: pytest.fail("it was parsed"))
    with pytest.raises(ValueError, match="more than a million lists"):
        parse_json(text)


def test_json_is_parsed():
    assert parse_json('{"a": [1, 2.5, "é"]}'.encode()) == {"a": [1, 2.5, "é"]}
    with pytest.raises(ValueError, match="utf-8"):
        parse_json(b"\xff")


def test_a_new_file_replaces_a_link_and_what_was_left(tmp_path):
    victim, link = tmp_path / "victim", tmp_path / "link"
    victim.write_text("mine")
    link.symlink_to(victim)
    for content in (b"one", b"two"):
        with new_file(link) as file:
            file.write(content)
        assert link.read_bytes() == content
        assert not link.is_symlink()
    assert victim.read_text() == "mine"


def test_lines_are_appended_to_a_file_that_is_made_where_there_is_none(tmp_path):
    for line in (b"one\n", b"two\n"):
        with append_file(tmp_path / "log") as file:
            file.write(line)
    assert (tmp_path / "log").read_bytes() == b"one\ntwo\n"


@pytest.mark.parametrize("kind", ["a link", "a named pipe", "a named pipe that is read", "a socket", "a device"])
def test_nothing_but_a_file_is_appended_to(tmp_path, kind):
    path, victim = tmp_path / "log", tmp_path / "victim"
    victim.write_text("precious")
    end = None
    if kind == "a link":
        path.symlink_to(victim)
    elif kind == "a socket":
        end = socket.socket(socket.AF_UNIX)
        end.bind(str(path))
    elif kind == "a device":
        path = Path("/dev/null")
    else:
        os.mkfifo(path)
        end = os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK)) if "read" in kind else None
    with pytest.raises(OSError, match=f"is {kind.partition(' that')[0]}; remove it") as refused:
        append_file(path)
    assert refused.value.filename == str(path)
    assert victim.read_text() == "precious"
    if end is not None:
        end.close()


def test_many_folders_are_removed_by_few_programs(tmp_path, monkeypatch):
    monkeypatch.setattr("sinew.runner.files.shutil.rmtree", lambda *_, **__: None)  # as where they are very deep
    for number in range(300):
        (tmp_path / "a" / str(number)).mkdir(parents=True)
    commands: list[str] = []
    run = subprocess.run
    monkeypatch.setattr("sinew.runner.files.subprocess.run", lambda c, **k: commands.append(c[0]) or run(c, **k))
    remove_folder(tmp_path / "a")
    assert not (tmp_path / "a").exists()
    assert commands == ["rm"]


def test_a_file_that_cannot_be_written_is_named_and_not_its_temporary_one(tmp_path):
    (tmp_path / "page.html").mkdir()
    with pytest.raises(OSError, match="directory") as error:
        write_whole(tmp_path / "page.html", b"a page")
    assert error.value.filename == str(tmp_path / "page.html")
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def test_a_file_that_others_may_replace_is_told(tmp_path, monkeypatch):
    folder = tmp_path / "bin"
    folder.mkdir(mode=0o755)
    program = folder / "program"
    program.write_text("")
    program.chmod(0o755)
    refuse_replaceable(program)
    cases = [(program, 0o757, "open"), (folder, 0o777, "open"), (folder, 0o1777, ""), (folder, 0o775, "open")]
    for path, mode, told in cases:
        monkeypatch.setattr("sinew.runner.files._is_private", lambda group: False)
        before = path.stat().st_mode & 0o7777
        path.chmod(mode)
        if told:
            with pytest.raises(PermissionError, match=told):
                refuse_replaceable(program)
        else:
            refuse_replaceable(program)
        monkeypatch.setattr("sinew.runner.files._is_private", lambda group: True)
        if mode == 0o775:
            refuse_replaceable(program)
        path.chmod(before)
    link = tmp_path / "link"
    link.symlink_to(program)
    refuse_replaceable(link)


def test_the_group_of_a_user_alone_is_no_one_else(monkeypatch):
    me = pwd.getpwuid(os.geteuid())
    of = {"name": me.pw_name, "members": []}
    monkeypatch.setattr(grp, "getgrgid", lambda group: grp.struct_group((of["name"], "x", group, of["members"])))
    assert _is_private(me.pw_gid)
    assert not _is_private(me.pw_gid + 1)
    of["members"] = [me.pw_name, "another"]
    assert not _is_private(me.pw_gid)
    of.update(name="users", members=[])
    assert not _is_private(me.pw_gid)
