import pytest

from stereohdr import memory
from stereohdr.errors import ConfigError, InputError, MemoryLimitError
from stereohdr.memory import MemoryPlan, check_plan, machine_memory, memory_limit, parse_size, size_text


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("4GiB", 4 * 2**30),
        ("500MB", 500_000_000),
        ("1.5 gb", 1_500_000_000),
        (" 2 MiB ", 2 * 2**20),
        ("3000000", 3_000_000),
        (3_000_000, 3_000_000),
        ("0.5TiB", 2**39),
        (".25GiB", 2**28),
    ],
)
def test_sizes_are_read_in_decimal_and_binary_units(text, size):
    assert parse_size(text) == size


@pytest.mark.parametrize("wrong", ["", "GiB", "4 apples", "-4GiB", "1e9", "4GiB5", "12", "nan", True, 1000, None])
def test_what_is_no_size_is_refused(wrong):
    with pytest.raises(ConfigError, match=r"such as 4GiB.*got"):
        parse_size(wrong)


@pytest.mark.parametrize(
    ("size", "text"),
    [(1, "1MiB"), (350 * 2**20, "350MiB"), (2**30, "1GiB"), (2**30 + 1, "1.1GiB"), (12 * 2**30 + 1, "13GiB")],
)
def test_sizes_are_written_so_that_they_suffice(size, text):
    assert size_text(size) == text
    assert parse_size(text) >= size


def test_half_of_the_memory_is_the_limit_unless_it_is_given(monkeypatch):
    monkeypatch.setattr(memory, "_physical_memory", lambda: 8 * 2**30)
    monkeypatch.setattr(memory, "_group_limits", list)
    assert memory_limit() == 4 * 2**30
    assert memory_limit("1GiB") == 2**30
    monkeypatch.setattr(memory, "_group_limits", lambda: [2**30, 2**40])
    assert machine_memory() == 2**30


@pytest.mark.parametrize(("has", "limit"), [(2**40, 2**39), (2**30, 2**29), (2**29, 2**29), (2**28, 2**28)])
def test_a_small_machine_gives_more_than_half(monkeypatch, has, limit):
    monkeypatch.setattr(memory, "machine_memory", lambda: has)
    assert memory_limit() == limit


def test_this_machine_has_memory():
    assert 2**28 < machine_memory() < 2**50


@pytest.fixture
def groups(tmp_path, monkeypatch):
    """A machine whose control groups are files: write them with the function that this gives."""
    monkeypatch.setattr(memory, "CONTROL_GROUPS", tmp_path / "cgroup")
    monkeypatch.setattr(memory, "OWN_GROUPS", tmp_path / "own")
    monkeypatch.setattr(memory, "_physical_memory", lambda: 64 * 2**30)

    def write(own, files):
        (tmp_path / "own").write_text(own)
        for name, content in files.items():
            path = tmp_path / "cgroup" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content)

    return write


def test_the_smallest_limit_of_the_groups_around_a_process_counts(groups):
    groups(
        "0::/user/app\n",
        {"memory.max": "max\n", "user/memory.max": "3221225472\n", "user/app/memory.max": "9999999999\n"},
    )
    assert machine_memory() == 3 * 2**30


def test_a_container_sees_its_limit_at_the_top(groups):
    groups("0::/outside/name\n", {"memory.max": "1073741824\n"})
    assert machine_memory() == 2**30


def test_groups_of_the_first_version_count(groups):
    groups("9:cpu,memory:/box\n3:cpuset:/\n", {"memory/box/memory.limit_in_bytes": "2147483648\n"})
    assert machine_memory() == 2 * 2**30


def test_a_group_whose_name_is_no_text_is_ignored(groups):
    groups("", {})
    memory.OWN_GROUPS.write_bytes(b"0::/\xff\n")
    assert machine_memory() == 64 * 2**30


def test_without_groups_the_machine_counts(groups):
    assert machine_memory() == 64 * 2**30


def test_a_plan_above_its_limit_is_refused_with_the_number_needed():
    plan = MemoryPlan(limit=2**30, estimate=3 * 2**30, stage="matching", strips=4, coarse_to_fine=False)
    with pytest.raises(
        MemoryLimitError, match=r"^a and b need about 3GiB .*matching.*limit is 1GiB.*--memory 3GiB"
    ):
        check_plan(plan, "a and b")
    assert issubclass(MemoryLimitError, InputError)
    check_plan(MemoryPlan(3 * 2**30, 3 * 2**30, "matching", 4, False), "a and b")
