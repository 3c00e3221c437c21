"""Training and scoring data as arrays: rendered rooms, real stereo pairs with turned copies, semi-real and RGB-D images.

A set is (images uint8 (N, 192, 320), depths float32 (N, 48, 80) for the canonical camera, 0 = unknown).
"""

import csv
import hashlib
import json
from pathlib import Path

import cv2
import numpy as np

from camera import CANONICAL, EUROC, HEIGHT, STRIDE, WIDTH, Camera
from stereo import Matcher, block_depth, grey, pairs

ROWS, COLUMNS = HEIGHT // STRIDE, WIDTH // STRIDE


def small(image: np.ndarray) -> np.ndarray:
    """An image as the network takes it."""
    return cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)


class Rooms:
    """Folders written by `libella rooms`, read on demand."""

    def __init__(self, folders: list[Path]):
        self.waiting, self.parts = list(folders), []
        if not self.more():
            raise SystemExit(f"{[str(folder) for folder in folders]}: no rendered rooms; make them with `libella rooms`")

    def more(self) -> int:
        """Takes in folders that have been finished since, and says how many."""
        before = len(self.parts)
        for folder in list(self.waiting):
            try:
                part = tuple(np.load(folder / f"{name}.npy", mmap_mode="r") for name in ("images", "depth_m", "views"))
            except (OSError, ValueError, EOFError):
                continue  # still being written
            if len(part[0]) and len({len(array) for array in part}) == 1:
                self.parts.append(part)
                self.waiting.remove(folder)
        self.ends = np.cumsum([len(part[0]) for part in self.parts])
        return len(self.parts) - before

    def __len__(self) -> int:
        return int(self.ends[-1])

    def take(self, indices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        images, depths = [], []
        for index in indices:
            k = int(np.searchsorted(self.ends, index, side="right"))
            row = int(index - (self.ends[k - 1] if k else 0))
            image, depth, view = (array[row] for array in self.parts[k])
            images.append(image)
            depths.append(depth * np.float32(CANONICAL.normalised[0] / view[1]))
        return np.stack(images), np.stack(depths)


class Stereo:
    """Real pairs: both images with the depth of semi-global matching, in raw pixels at full size. Kept in a cache folder."""

    def __init__(self, folder: Path, cache: Path):
        self.pairs = pairs(folder)
        cache.mkdir(parents=True, exist_ok=True)
        key = hashlib.sha1(f"{folder.resolve()} {len(self.pairs)} 4".encode()).hexdigest()[:12]
        file = cache / f"stereo-{key}.npz"
        if not file.exists():
            matcher = Matcher()
            images, depths = [], []
            for _, left, right in self.pairs:
                both = [grey(left), grey(right)]
                images.append(both)
                depths.append(matcher.raw_depths(*both))
            np.savez(file, images=np.array(images), depths=np.array(depths, np.float16))
        stored = np.load(file)
        self.images, self.depths = stored["images"], stored["depths"].astype(np.float32)
        self.stamps = np.array([stamp for stamp, _, _ in self.pairs])

    def scored(self, indices) -> tuple[np.ndarray, np.ndarray]:
        """Left images and block medians of their depths: what figures are taken on."""
        images = np.stack([small(self.images[k, 0]) for k in indices])
        return images, np.stack([block_depth(self.depths[k, 0], ROWS, COLUMNS) for k in indices])

    def turned(self, indices, copies: int, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Both images of each pair, as they are and as cameras on the same spot would see it that look elsewhere, roll, or
        have a longer lens. Turning a camera needs no depth, so the images are exact; depths turn with their rays."""
        images, depths = [], []
        for k in indices:
            for side in (0, 1):
                for copy in range(copies):
                    image, depth = turned(self.images[k, side], self.depths[k, side], EUROC[side], generator, copy > 0)
                    images.append(image)
                    depths.append(depth)
        return np.stack(images), np.stack(depths)


# Raw images shrink to half before they are turned: what is left is close to the size that the network takes.
_HALF = {camera: camera.resized(376, 240) for camera in EUROC}
_NINE = CANONICAL.resized(3 * COLUMNS, 3 * ROWS)
_RAYS = {camera: camera.rays() for camera in (CANONICAL, _NINE)}


def turned(image, depth, camera: Camera, generator, change: bool) -> tuple[np.ndarray, np.ndarray]:
    """The image and depth of the canonical camera at the same place, turned and with a lens `zoom` times as long."""
    zoom, angles = 1.0, np.zeros(3)
    if change:
        zoom = float(np.exp(generator.uniform(-0.02, 0.06)))
        angles = np.radians(generator.normal(0, (4, 6, 4)))
    old_from_new = cv2.Rodrigues(angles)[0]

    def looked_up(at: Camera, source: Camera):
        rays = (_RAYS[at] * np.array([1 / zoom, 1 / zoom, 1])) @ old_from_new.T
        pixels, seen = source.project(rays)
        return pixels[..., 0].astype(np.float32), pixels[..., 1].astype(np.float32), seen, rays[..., 2]

    half = _HALF[camera]
    x, y, _, _ = looked_up(CANONICAL, half)
    picture = cv2.remap(cv2.resize(image, half.size, interpolation=cv2.INTER_AREA), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    # Depth: the median of nine samples spread over each block, of those that are known if half of them are.
    x, y, seen, along = looked_up(_NINE, camera)
    z = cv2.remap(depth, x, y, cv2.INTER_NEAREST, borderValue=0) / np.maximum(along, 0.1)
    z = np.where(seen & (z > 0), z, np.inf)
    cells = np.sort(z.reshape(ROWS, 3, COLUMNS, 3).transpose(0, 2, 1, 3).reshape(ROWS, COLUMNS, 9), axis=-1)
    count = np.isfinite(cells).sum(-1)
    middle = np.take_along_axis(cells, np.maximum(count - 1, 0)[..., None] // 2, -1)[..., 0]
    # Seen through a longer lens, things look nearer to a network that believes in the canonical one.
    return picture, np.where(count >= 4, middle / zoom, 0).astype(np.float32)


def poses(file: Path) -> dict[int, np.ndarray]:
    """World from body of a EuRoC ground truth or of `keyframes_gt.csv`, by stamp."""
    out = {}
    for row in csv.reader(file.open()):
        if row and not row[0].startswith("#"):
            p, (w, x, y, z) = np.array(row[1:4], float), map(float, row[4:8])
            pose = np.eye(4)
            pose[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
            pose[:3, 3] = p
            out[int(row[0])] = pose
    return out


def semi_real(folder: Path, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Images of a semi-real sequence (`scene.json`, `cam0.mkv`) spread over its length, with exact depth."""
    scene = json.loads((folder / "scene.json").read_text())
    truth = poses(folder / "mav0/state_groundtruth_estimate0/data.csv")
    stamps = np.array(sorted(truth))
    frames = [int(line.split(",")[0]) for line in (folder / "mav0/cam0/data.csv").read_text().splitlines() if line[:1] != "#"]
    chosen = set(np.linspace(0, len(frames) - 1, count).astype(int).tolist())
    video = cv2.VideoCapture(str(folder / "cam0.mkv"))
    rays = CANONICAL.resized(COLUMNS, ROWS).rays()
    images, depths = [], []
    for index, stamp in enumerate(frames):
        ok, image = video.read()
        if not ok:
            break
        if index not in chosen:
            continue
        nearest = int(stamps[np.abs(stamps - stamp).argmin()])
        if abs(nearest - stamp) > 3_000_000:
            continue
        images.append(small(image[..., 0]))
        depths.append(boxes_depth(scene, truth[nearest] @ EUROC[0].body_from_camera, rays))
    return np.stack(images), np.stack(depths)


def boxes_depth(scene: dict, world_from_camera: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Depth along the optical axis in a room of axis-aligned boxes, by slabs."""
    directions = rays @ world_from_camera[:3, :3].T
    origin = world_from_camera[:3, 3]
    directions = np.where(abs(directions) < 1e-12, 1e-12, directions)

    def crossing(box):
        a, b = ((np.array(box[side]) - origin) / directions for side in ("min", "max"))
        return np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)

    depth = crossing(scene["room"])[1]
    for box in scene["boxes"]:
        near, far = crossing(box)
        depth = np.where((near < far) & (near > 0) & (near < depth), near, depth)
    return depth.astype(np.float32)


def rgbd(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Images of another camera and another room, depths divided by its zoom against the canonical camera."""
    numbers = [float(v) for v in (folder / "K.txt").read_text().split()]
    images, depths = [], []
    for path in sorted((folder / "images").iterdir()):
        image = grey(path)
        stem = path.stem
        depth_file = next(f for f in sorted((folder / "depth").iterdir()) if f.stem == stem)
        depth = cv2.imread(str(depth_file), cv2.IMREAD_UNCHANGED).astype(np.float32) / 1000
        zoom = numbers[0] / image.shape[1] / CANONICAL.normalised[0]
        # The vertical focal length would not fit: cut to the shape where both agree.
        rows = int(round(numbers[4] / zoom / CANONICAL.normalised[1]))
        top = max(0, (image.shape[0] - rows) // 2)
        depth = cv2.resize(depth, image.shape[::-1], interpolation=cv2.INTER_NEAREST)
        images.append(small(image[top : top + rows]))
        depths.append(block_depth(depth[top : top + rows], ROWS, COLUMNS) / zoom)
    return np.stack(images), np.stack(depths).astype(np.float32)


def simulated(folder: Path, every: int = 10) -> tuple[np.ndarray, np.ndarray]:
    """Images of a recording of `libella simulate` with exact depth."""
    images, depths = [], []
    for path in sorted((folder / "mav0/cam0/data").iterdir())[::every]:
        depth = cv2.imread(str(folder / "mav0/cam0/depth" / path.name), cv2.IMREAD_UNCHANGED)
        images.append(small(grey(path)))
        depths.append(block_depth(depth.astype(np.float32) / 1000, ROWS, COLUMNS))
    return np.stack(images), np.stack(depths)


def split(count: int, kind: str) -> dict[str, list[int]]:
    """Which keyframes train, which choose (steps, calibration of u) and which are scored.

    `interleaved`: every fifth is scored, and of each ten one chooses. `contiguous`: the last 30 % are scored, the 10 % before
    them choose.
    """
    if kind == "interleaved":
        scored = [k for k in range(count) if k % 5 == 2]
        chosen = [k for k in range(count) if k % 10 == 5]
    elif kind == "contiguous":
        first = count - round(0.3 * count)
        scored = list(range(first, count))
        chosen = list(range(first - round(0.1 * count), first))
    else:
        raise SystemExit(f"`{kind}` is no split: interleaved or contiguous")
    return {"train": [k for k in range(count) if k not in scored and k not in chosen], "choose": chosen, "score": scored}
