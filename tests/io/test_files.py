import pytest

from stereohdr.errors import FileFormatError, OutputError
from stereohdr.io.files import atomic_path


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


def test_missing_folder_and_folder_as_target(tmp_path):
    with pytest.raises(FileFormatError, match="does not exist"), atomic_path(tmp_path / "no" / "a.hdr"):
        pass
    with pytest.raises(FileFormatError, match="is a folder"), atomic_path(tmp_path):
        pass
