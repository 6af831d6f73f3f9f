import pytest

from stereohdr.errors import FileFormatError, InputError, OutputError
from stereohdr.io.files import atomic_path, new_folder


def test_success_replaces_the_target_and_leaves_nothing_else(tmp_path):
    target = tmp_path / "result.exr"
    target.write_bytes(b"old")
    with atomic_path(target) as temporary:
        assert temporary.suffix == ".exr"
        assert temporary.parent == tmp_path
        temporary.write_bytes(b"new")
        assert target.read_bytes() == b"old"
    assert target.read_bytes() == b"new"
    assert [p.name for p in tmp_path.iterdir()] == ["result.exr"]


@pytest.mark.parametrize("failure", [RuntimeError("boom"), KeyboardInterrupt()])
def test_failure_keeps_the_old_file_and_removes_the_temporary_one(tmp_path, failure):
    target = tmp_path / "result.exr"
    target.write_bytes(b"old")

    def write_half():
        with atomic_path(target) as temporary:
            temporary.write_bytes(b"half")
            raise failure

    with pytest.raises(type(failure)):
        write_half()
    assert target.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["result.exr"]


def test_a_full_disk_is_a_sentence(tmp_path):
    with (
        pytest.raises(OutputError, match=r"a\.hdr: cannot be written \(No space left on device\); make room"),
        atomic_path(tmp_path / "a.hdr"),
    ):
        raise OSError(28, "No space left on device")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("no/a.hdr", "{}: the folder {parent} does not exist; create it first"),
        ("file/a.hdr", "{}: the folder {parent} does not exist; create it first"),
        (".", "{}: is a folder; give the name of a file"),
    ],
)
def test_names_that_no_file_can_have_are_one_sentence(tmp_path, name, message):
    (tmp_path / "file").touch()
    path = tmp_path / name
    with pytest.raises(FileFormatError) as error, atomic_path(path):
        pass
    assert str(error.value) == message.format(path, parent=path.parent)


def test_a_new_folder_vanishes_if_nothing_came_of_it(tmp_path):
    def fill(path, *names):
        with new_folder(path) as folder:
            for name in names:
                (folder / name).touch()
            raise InputError("a sentence")

    with pytest.raises(InputError, match="a sentence"):
        fill(tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []
    for _ in range(2):  # the second time it is there already
        with pytest.raises(InputError, match="a sentence"):
            fill(tmp_path / "a" / "b", "written.png")
        assert (tmp_path / "a" / "b" / "written.png").exists()
    (tmp_path / "old").mkdir()
    with pytest.raises(InputError, match="a sentence"):
        fill(tmp_path / "old")
    assert (tmp_path / "old").is_dir()
    (tmp_path / "file").touch()
    with pytest.raises(FileFormatError, match="is a file; give the name of a folder"):
        fill(tmp_path / "file")
