"""Photographs, raw previews and videos: what is read of them, that they come upright, that nothing hostile passes."""

import os
import struct
import unicodedata
from datetime import datetime, timedelta, timezone
from io import BytesIO

import cv2
import numpy as np
import pytest
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.imaging.read import UnreadableImage, register_heif
from toolkit.rooms.photos.photo import (
    ExifFacts,
    Photo,
    list_photos,
    load_pixels,
    natural_key,
    read_exif,
    read_photo,
    show_name,
    write_exif,
)
from toolkit.rooms.photos.video import load_frame, pick_frames, read_video

register_heif()
RED, GREEN, BLUE = (220, 40, 30), (30, 200, 60), (40, 60, 210)
TURN_BACK = {1: 0, 3: 2, 6: 1, 8: 3}
"""Quarter turns counter-clockwise from the upright picture to the one that a camera stores."""


def scene(width=96, height=64) -> np.ndarray:
    """Red left, blue right, green on top."""
    pixels = np.empty((height, width, 3), np.uint8)
    pixels[:, : width // 2], pixels[:, width // 2 :], pixels[: height // 4] = RED, BLUE, GREEN
    return pixels


def is_scene(pixels: np.ndarray, tolerance=30) -> bool:
    height, width = pixels.shape[:2]
    spots = {(0.1, 0.5): GREEN, (0.7, 0.15): RED, (0.7, 0.85): BLUE}
    return all(
        np.abs(pixels[int(v * height), int(u * width)].astype(int) - colour).max() <= tolerance
        for (v, u), colour in spots.items()
    )


def camera_exif(orientation=1) -> bytes:
    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[0x0112] = "Acme\0junk", "Acme Phone 3", orientation
    details = exif.get_ifd(0x8769)
    details[0x9003], details[0x9291], details[0x9011] = "2024:05:01 10:11:12", "25", "+02:00"
    details[0x920A], details[0xA405] = 4.25, 26
    exif[0x8769] = dict(details)
    return exif.tobytes()


def stored(orientation: int) -> Image.Image:
    return Image.fromarray(np.ascontiguousarray(np.rot90(scene(), TURN_BACK[orientation])))


@pytest.mark.parametrize("orientation", TURN_BACK)
@pytest.mark.parametrize(
    ("suffix", "kind"), [(".jpg", "jpeg"), (".png", "png"), (".webp", "webp"), (".tif", "tiff"), (".heic", "heif")]
)
def test_a_photograph_says_what_the_camera_wrote_and_comes_upright(tmp_path, suffix, kind, orientation):
    file = tmp_path / f"IMG{suffix}"
    stored(orientation).save(file, exif=camera_exif(orientation), quality=95)
    photo = read_photo(file)
    zone = timezone(timedelta(hours=2))
    assert photo == Photo(
        file, sha256_file(file), kind, 96, 64, datetime(2024, 5, 1, 10, 11, 12, 250000, zone), "Acme Phone 3", 4.25, 26
    )
    pixels = load_pixels(photo)
    assert pixels.shape == (64, 96, 3) and is_scene(pixels)


def test_the_content_says_the_kind_and_not_the_name(tmp_path):
    Image.fromarray(scene()).save(tmp_path / "a.png")
    (tmp_path / "a.png").rename(tmp_path / "a.jpg")
    assert read_photo(tmp_path / "a.jpg").kind == "png"


def test_without_exif_nothing_is_made_up(tmp_path):
    Image.fromarray(scene()).save(tmp_path / "a.jpg")
    photo = read_photo(tmp_path / "a.jpg")
    assert (photo.taken, photo.camera, photo.focal_mm, photo.focal_35mm_mm, photo.frame) == (None,) * 5


@pytest.mark.parametrize(
    "fields",
    [
        {0x9003: "0000:00:00 00:00:00"}, {0x9003: "2024:13:45 99:99:99"}, {0x9003: "yesterday"}, {0xA405: 0},
        {0x9003: "٢٠٢٤:٠٥:٠١ 10:11:12"}, {0x920A: (0, 0)}, {0xA405: 65535},
    ],
)  # fmt: skip
def test_nonsense_in_exif_is_left_out(tmp_path, fields):
    exif = Image.Exif()
    exif[0x8769] = fields
    Image.fromarray(scene()).save(tmp_path / "a.jpg", exif=exif)
    photo = read_photo(tmp_path / "a.jpg")
    assert (photo.taken, photo.focal_mm, photo.focal_35mm_mm) == (None, None, None)


def test_damaged_exif_does_not_cost_the_photograph(tmp_path):
    block = bytearray(camera_exif())
    block[20:60] = b"\xff" * 40
    Image.fromarray(scene()).save(tmp_path / "a.jpg", exif=bytes(block))
    assert is_scene(load_pixels(read_photo(tmp_path / "a.jpg")))


def test_facts_survive_being_written():
    for zone in (None, timezone.utc, timezone(timedelta(hours=-9, minutes=-30))):
        facts = ExifFacts(datetime(2023, 1, 2, 3, 4, 5, 678000, zone), "Acme Phone 3", 4.5, 26.0, 6)
        exif = Image.Exif()
        exif.load(write_exif(facts))
        assert read_exif(exif) == facts


def jpeg(pixels: np.ndarray) -> bytes:
    buffer = BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=95, subsampling=0)
    return buffer.getvalue()


def make_dng(previews=None, orientation=1, order="<", raw=True) -> bytes:
    """A DNG by hand: a thumbnail's directory, SubIFDs with raw data and JPEG previews, EXIF with the time.

    Written from the TIFF 6.0 and DNG 1.4 specifications, with nothing of the reader's.
    """
    body = bytearray(b"II*\0" if order == "<" else b"MM\0*") + bytearray(4)

    def put(content: bytes) -> int:
        body.extend(b"\0" * (len(body) % 2))
        body.extend(content)
        return len(body) - len(content)

    def directory(entries) -> int:
        packed = []
        for tag, kind, values in sorted(entries):
            if kind == 2:
                data, count = values.encode() + b"\0", len(values) + 1
            else:
                code = {1: "B", 3: "H", 4: "I", 5: "II"}[kind]
                flat = [n for value in values for n in (value if isinstance(value, tuple) else (value,))]
                data, count = struct.pack(order + code[0] * len(flat), *flat), len(values)
            where = data.ljust(4, b"\0") if len(data) <= 4 else struct.pack(order + "I", put(data))
            packed.append(struct.pack(order + "HHI", tag, kind, count) + where)
        return put(struct.pack(order + "H", len(packed)) + b"".join(packed) + bytes(4))

    subs = []
    if raw:
        sensor = bytes(range(64))
        subs.append(
            directory(
                [(254, 4, [0]), (256, 4, [8]), (257, 4, [8]), (259, 3, [1]), (262, 3, [32803]),
                 (273, 4, [put(sensor)]), (279, 4, [64])]
            )
        )  # fmt: skip
    for content in previews if previews is not None else [jpeg(scene(48, 32)), jpeg(scene())]:
        subs.append(
            directory(
                [(254, 4, [1]), (256, 4, [1]), (257, 4, [1]), (259, 3, [7]), (262, 3, [6]), (273, 4, [put(content)]),
                 (279, 4, [len(content)])]
            )
        )  # fmt: skip
    exif = directory([(0x9003, 2, "2024:05:01 10:11:12"), (0x920A, 5, [(425, 100)]), (0xA405, 3, [26])])
    first = directory(
        [(254, 4, [1]), (256, 4, [2]), (257, 4, [2]), (258, 3, [8, 8, 8]), (259, 3, [1]), (262, 3, [2]),
         (271, 2, "Acme"), (272, 2, "Acme Phone 3"), (273, 4, [put(bytes(12))]), (274, 3, [orientation]),
         (277, 3, [3]), (279, 4, [12]), (330, 4, subs), (0x8769, 4, [exif]), (50706, 1, [1, 4, 0, 0])]
    )  # fmt: skip
    body[4:8] = struct.pack(order + "I", first)
    return bytes(body)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("orientation", TURN_BACK)
def test_a_raw_photograph_shows_its_largest_preview_upright(tmp_path, order, orientation):
    small, large = (np.rot90(one, TURN_BACK[orientation]) for one in (scene(48, 32), scene()))
    (tmp_path / "a.dng").write_bytes(make_dng([jpeg(small), jpeg(large)], orientation, order))
    photo = read_photo(tmp_path / "a.dng")
    assert (photo.kind, photo.width, photo.height) == ("dng", 96, 64)
    assert (photo.taken, photo.camera) == (datetime(2024, 5, 1, 10, 11, 12), "Acme Phone 3")
    assert (photo.focal_mm, photo.focal_35mm_mm) == (4.25, 26)
    pixels = load_pixels(photo)
    assert pixels.shape == (64, 96, 3) and is_scene(pixels, 12)


def test_a_raw_photograph_without_a_preview_says_what_to_do(tmp_path):
    for previews in ([], [b"\xff\xd8\xff" + bytes(100)], [b"no jpeg at all"]):
        (tmp_path / "a.dng").write_bytes(make_dng(previews))
        with pytest.raises(UnreadableImage, match="DNG without a JPEG preview: export it"):
            read_photo(tmp_path / "a.dng")


def test_no_damage_to_a_raw_photograph_is_worse_than_an_error(tmp_path):
    """Cut at every length, and every byte of the directories changed: a result or one error, and never a hang."""
    whole = make_dng([jpeg(scene(24, 16))])
    file = tmp_path / "a.dng"
    rng = np.random.default_rng(1)
    spoiled = [whole[:n] for n in range(0, len(whole), 97)]
    for _ in range(80):
        content = bytearray(whole)
        for at in rng.integers(0, len(whole), 4):
            content[at] = rng.integers(256)
        spoiled.append(bytes(content))
    outcomes = set()
    for content in spoiled:
        file.write_bytes(content)
        try:
            load_pixels(read_photo(file))
            outcomes.add("read")
        except UnreadableImage as error:
            assert error.reason
            outcomes.add("refused")
    assert outcomes == {"read", "refused"}


def test_directories_that_point_at_each_other_end(tmp_path):
    content = bytearray(make_dng([]))
    (first,) = struct.unpack("<I", content[4:8])
    (count,) = struct.unpack("<H", content[first : first + 2])
    after = first + 2 + 12 * count
    content[after : after + 4] = struct.pack("<I", first)
    (tmp_path / "a.dng").write_bytes(content)
    with pytest.raises(UnreadableImage, match="without a JPEG preview"):
        read_photo(tmp_path / "a.dng")


def write_video(file, parts, fps=30.0, size=(160, 120)):
    """`parts`: lists of pictures; each part is written as it is."""
    writer = cv2.VideoWriter(
        str(file), cv2.VideoWriter_fourcc(*("mp4v" if file.suffix == ".mp4" else "MJPG")), fps, size
    )
    assert writer.isOpened()
    for part in parts:
        for pixels in part:
            writer.write(cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))
    writer.release()
    return file


LONG = cv2.resize(
    np.random.default_rng(0).integers(0, 256, (40, 534, 3), dtype=np.uint8), (1600, 120), interpolation=cv2.INTER_CUBIC
)


def view(place: float, blur=0.0, seed=None) -> np.ndarray:
    """What a camera sees when it has moved `place` pixels along a long picture."""
    shift = np.array([[1, 0, -place], [0, 1, 0]], float)
    pixels = cv2.warpAffine(LONG, shift, (160, 120), borderMode=cv2.BORDER_REFLECT)
    if blur:
        pixels = cv2.GaussianBlur(pixels, (0, 0), blur)
    if seed is not None:
        noise = np.random.default_rng(seed).normal(0, 4, pixels.shape)
        pixels = np.clip(pixels + noise, 0, 255).astype(np.uint8)
    return pixels


def hold(place, frames, tremor=0.0, sharp=()):
    """A hand that holds the camera still: focus is found in the frames of `sharp` only."""
    drift = np.random.default_rng(int(place)).normal(0, tremor, frames)
    return [view(place + drift[i], 0 if not sharp or i in sharp else 1.5, i) for i in range(frames)]


def move(start, end, frames):
    return [view(place, 0.8, i) for i, place in enumerate(np.linspace(start, end, frames))]


def test_one_frame_per_still_moment_and_the_sharpest(tmp_path):
    parts = [
        hold(0, 30, 0.3, sharp=range(20, 24)), move(0, 300, 40), hold(300, 24, 0.3), move(300, 700, 40),
        hold(700, 36, 0.3, sharp=range(2, 8)),
    ]  # fmt: skip
    file = write_video(tmp_path / "clip.mp4", parts)
    frames = pick_frames(file)
    assert len(frames) == 3
    assert frames[0] in range(20, 24) and 70 <= frames[1] < 94 and frames[2] - 134 in range(2, 8)
    for frame, place in zip(frames, (0, 300, 700), strict=True):
        assert np.abs(load_frame(file, frame).astype(int) - view(place)).mean() < 20
    assert frames == pick_frames(file)


def test_a_cut_parts_two_moments_and_a_jolt_does_not(tmp_path):
    cut = write_video(tmp_path / "cut.avi", [hold(0, 24), hold(300, 24)])
    assert len(pick_frames(cut)) == 2
    jolt = write_video(tmp_path / "jolt.mp4", [move(900, 1200, 40), hold(0, 24), [view(12)], hold(0, 24)])
    assert len(pick_frames(jolt)) == 1


def test_a_video_that_never_stands_still_says_so_and_can_be_taken_by_time(tmp_path):
    file = write_video(tmp_path / "walk.mp4", [move(0, 1200, 90)])
    with pytest.raises(UnreadableImage, match=r"never held still.*every_s"):
        pick_frames(file)
    frames = pick_frames(file, every_s=1.0)
    assert [frame // 30 for frame in frames] == [0, 1, 2]
    with pytest.raises(ToolkitError, match="every_s 0"):
        pick_frames(file, every_s=0.0)


def test_frames_are_counted_and_the_film_says_when_it_began(tmp_path):
    shades = [np.full((120, 160, 3), 8 * i, np.uint8) for i in range(30)]
    file = write_video(tmp_path / "clip.mp4", [shades])
    for frame in (0, 17, 5, 29):
        assert abs(float(load_frame(file, frame).mean()) - 8 * frame) < 4
    with pytest.raises(UnreadableImage, match="truncated"):
        load_frame(file, 40)
    assert read_photo(file).kind == "video"
    content = bytearray(file.read_bytes())
    at = content.index(b"mvhd") + 8
    seconds = int(
        (datetime(2024, 5, 1, 10, tzinfo=timezone.utc) - datetime(1904, 1, 1, tzinfo=timezone.utc)).total_seconds()
    )
    content[at : at + 4] = seconds.to_bytes(4, "big")
    file.write_bytes(content)
    assert read_video(file).began == datetime(2024, 5, 1, 10, tzinfo=timezone.utc)
    assert read_video(file).taken_at(15) == datetime(2024, 5, 1, 10, 0, 0, 500000, timezone.utc)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "empty"),
        (b"GIF89a nonsense", "not an image|damaged|truncated"),
        (b"#EXTM3U\n#EXTINF:1,\nfile:///etc/passwd\n", "not an image"),
        (b"ffconcat version 1.0\nfile /etc/passwd\n", "not an image"),
        (b"\0\0\0\x18ftypisom" + bytes(64), "damaged video"),
        (b"RIFF\x24\0\0\0AVI LIST" + bytes(30), "damaged video"),
        (b"\x80\x04\x95pickled", "not an image"),
    ],
)
@pytest.mark.parametrize("name", ["a.mp4", "a.jpg"])
def test_hostile_content_is_one_reason(tmp_path, capfd, content, reason, name):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UnreadableImage, match=reason):
        read_photo(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def test_a_truncated_photograph_has_facts_but_no_pixels(tmp_path):
    file = tmp_path / "a.jpg"
    noise = np.random.default_rng(0).integers(0, 256, (200, 300, 3), dtype=np.uint8)
    Image.fromarray(noise).save(file, exif=camera_exif())
    file.write_bytes(file.read_bytes()[:9000])
    photo = read_photo(file)
    assert photo.width == 300
    with pytest.raises(UnreadableImage, match="truncated"):
        load_pixels(photo)


def test_pipes_and_missing_files_are_never_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe.jpg")
    for name, reason in (("pipe.jpg", "plain file"), ("none.jpg", "no such file"), ("nul\0.jpg", "no such file|null")):
        with pytest.raises(UnreadableImage, match=reason):
            read_photo(tmp_path / name)


def test_a_folder_is_listed_in_the_order_of_its_counters(tmp_path):
    (tmp_path / "DCIM").mkdir()
    for name in ("IMG_10.jpg", "IMG_9.HEIC", "IMG_9.MOV", "DCIM/a.dng", "notes.txt", ".hidden.jpg", "x.AAE"):
        (tmp_path / name).write_bytes(b"x")
    outside = tmp_path.parent / "outside.jpg"
    outside.write_bytes(b"x")
    (tmp_path / "link.jpg").symlink_to(outside)
    found = list_photos(tmp_path)
    assert [str(path.relative_to(tmp_path)) for path in found.photos] == [
        "DCIM/a.dng", "IMG_9.HEIC", "IMG_9.MOV", "IMG_10.jpg",
    ]  # fmt: skip
    assert [path for path, _ in found.refused] == ["link.jpg"] and set(found.others) == {"notes.txt", "x.AAE"}
    for path, what in ((tmp_path / "no", "does not exist"), (tmp_path / "notes.txt", "is a file")):
        with pytest.raises(ToolkitError, match=what):
            list_photos(path)


def test_names_are_shown_on_one_line_and_sorted_as_people_do():
    assert show_name("a\nb\x1b[31m.jpg") == "a\\nb\\x1b[31m.jpg" and show_name("größe.jpg") == "größe.jpg"
    assert show_name("a\udcff.jpg").isprintable()
    names = ["IMG_9", "IMG_10", "img_1", "²", "٣", "10"]
    assert sorted(names, key=natural_key)[:4] == ["10", "img_1", "IMG_9", "IMG_10"]
    # what a phone or a desktop adds to a name that is taken comes after the name itself
    taken = [
        "IMG_1.jpg", "IMG_1 (1).jpg", "IMG_1 (2).jpg", "IMG_1 (10).jpg", "IMG_2.jpg", "IMG_2~2.jpg", "IMG_2~3.jpg",
        "IMG_3.jpg", "IMG_3 copy.jpg", "IMG_3 copy 2.jpg", "IMG_4.jpg", "IMG_4 - Copy.jpg", "IMG_4 - Copy (2).jpg",
        "IMG_10.jpg", "IMG_10(1).jpg",
    ]  # fmt: skip
    assert sorted(reversed(taken), key=natural_key) == taken
    assert natural_key(unicodedata.normalize("NFD", "caf\u00e9 2.jpg")) == natural_key("caf\u00e9 2.jpg")
    assert show_name(unicodedata.normalize("NFD", "gr\u00f6\u00dfe.jpg")) == "gr\u00f6\u00dfe.jpg"
