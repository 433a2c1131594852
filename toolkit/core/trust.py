"""Folders whose files run as code: none is used that anybody but its user could have filled."""

import os
import stat
from collections.abc import Iterator
from pathlib import Path

OTHERS_READ_OR_WRITE = stat.S_IRWXG | stat.S_IRWXO


def make_private(folder: Path) -> bool:
    """Make a folder, and those above it that are missing, for this user alone; whether it was not there before.

    Raises:
        OSError: it cannot be made.
    """
    missing = [place for place in (folder, *folder.parents) if not place.is_dir()]
    for place in reversed(missing):
        place.mkdir(mode=0o700, exist_ok=True)
    return bool(missing)


def explain_distrust(folder: Path) -> str:
    """Why somebody else could have put a file into a folder, or the folder into its place; empty where nobody could.

    All that lies in it must be this user's, no link, and closed to the writing of others. The folders above may be the
    administrator's too, or shared if they are sticky as /tmp is. On Windows nothing is looked at: a user's profile is
    closed to others there.
    """
    if not hasattr(os, "geteuid"):
        return ""
    mine = os.geteuid()
    trusted = (mine, Path("/").stat().st_uid)  # the administrator, whatever number a container gives him
    folder = folder.absolute()
    for above in dict.fromkeys((*folder.parents, *(folder.parent.resolve() / folder.name).parents)):
        facts = above.stat()
        if facts.st_uid not in trusted:
            return f"{above} belongs to another user"
        if _is_open(facts) and not facts.st_mode & stat.S_ISVTX:
            return f"others may write to {above}"
    is_closed = not folder.lstat().st_mode & OTHERS_READ_OR_WRITE
    for path, facts in _look_through(folder):
        if stat.S_ISLNK(facts.st_mode):
            return f"{path} is a link"
        if facts.st_uid != mine:
            return f"{path} belongs to another user"
        has_second_name = stat.S_ISREG(facts.st_mode) and facts.st_nlink > 1
        if _is_open(facts) and (not is_closed or has_second_name):  # nobody else comes into a closed folder
            return f"others may write to {path}"
    return ""


def _look_through(folder: Path) -> Iterator[tuple[Path, os.stat_result]]:
    yield folder, folder.lstat()
    for path in folder.rglob("*"):
        try:
            yield path, path.lstat()
        except FileNotFoundError:  # another process is compiling, and has just renamed a file
            continue


def _is_open(facts: os.stat_result) -> bool:
    """Whether anybody but its owner may write to it; a group of the owner alone, as many systems make, is nobody."""
    if facts.st_mode & stat.S_IWOTH:
        return True
    return bool(facts.st_mode & stat.S_IWGRP) and not _is_own_group(facts)


def _is_own_group(facts: os.stat_result) -> bool:
    import grp
    import pwd

    try:
        owner, group = pwd.getpwuid(facts.st_uid), grp.getgrgid(facts.st_gid)
    except KeyError:
        return False
    is_theirs = owner.pw_gid == group.gr_gid and owner.pw_name == group.gr_name
    return is_theirs and set(group.gr_mem) <= {owner.pw_name}
