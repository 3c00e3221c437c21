"""What can be known without data: `python -m unittest` in this folder, half a minute."""

import tempfile
import unittest
import warnings
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch

import augment
import losses
import metrics
from average import averaged
from camera import CANONICAL, EUROC, HEIGHT, WIDTH
from data import boxes_depth, split, turned
from network import DepthNetwork, folded, unfolded
from stereo import Matcher, block_depth


def painted(points: np.ndarray) -> np.ndarray:
    """Grey values of a textured plane at (x, y) metres: sums of waves down to centimetres."""
    value = np.zeros(points.shape[:-1])
    for k, length in enumerate((0.9, 0.37, 0.21, 0.11, 0.063)):
        angle = 0.7 + 1.9 * k
        value += np.sin(2 * np.pi / length * (points[..., 0] * np.cos(angle) + points[..., 1] * np.sin(angle)) + k)
    return (127 + 24 * value).astype(np.uint8)


class Geometry(unittest.TestCase):
    def test_rays_project_to_their_pixels(self):
        for camera in (*EUROC, CANONICAL):
            pixels, seen = camera.project(camera.rays())
            there = np.stack(np.meshgrid(np.arange(camera.size[0]), np.arange(camera.size[1])), -1)
            self.assertLess(abs(pixels - there).max(), 1e-6)
            self.assertTrue(seen.all())

    def test_matching_finds_the_distance_of_a_wall(self):
        # A wall 2 m in front of the left camera, seen by both raw cameras.
        distance = 2.0
        images = []
        right_from_left = np.linalg.inv(EUROC[1].body_from_camera) @ EUROC[0].body_from_camera
        for camera, camera_from_left in zip(EUROC, (np.eye(4), right_from_left)):
            directions = camera.rays() @ camera_from_left[:3, :3]
            origin = -camera_from_left[:3, :3].T @ camera_from_left[:3, 3]
            reach = (distance - origin[2]) / directions[..., 2]
            images.append(painted(origin + directions * reach[..., None]))
        depth = Matcher().raw_depths(*images)[0]
        known = depth > 0
        self.assertGreater(known.mean(), 0.6)
        # The matcher likes whole pixels; half a pixel of a disparity of 23.7 px is 2.1 %.
        self.assertLess(np.median(abs(depth[known] / distance - 1)), 0.021)

    def test_a_turned_camera_sees_the_same_points(self):
        # Depth of a slanted plane n.x = 1, turned: every ray must meet that plane, turned the same way.
        n = np.array([0.1, -0.2, 0.4])
        depth = (1.0 / (EUROC[0].rays() @ n)).astype(np.float32)
        seed = 5
        image, new = turned(painted(EUROC[0].rays()), depth, EUROC[0], np.random.default_rng(seed), True)
        generator = np.random.default_rng(seed)
        zoom = np.exp(generator.uniform(-0.02, 0.06))
        old_from_new = cv2.Rodrigues(np.radians(generator.normal(0, (4, 6, 4))))[0]
        rays = CANONICAL.resized(80, 48).rays() * np.array([1 / zoom, 1 / zoom, 1])
        expected = 1.0 / (rays @ old_from_new.T @ n) / zoom
        known = new > 0
        self.assertGreater(known.mean(), 0.8)
        # Depth changes by up to 0.4 % per raw pixel. Looked up within half a pixel; where a block is half known, its median is
        # off its middle by up to a quarter of its 9 to 10 pixels.
        error = abs(new[known] / expected[known] - 1)
        self.assertLess(np.median(error), 0.002)
        self.assertLess(error.max(), 0.02)

    def test_boxes_hide_the_wall_behind_them(self):
        scene = {"room": {"min": [-2, -2, 0], "max": [2, 2, 3]}, "boxes": [{"min": [1, -0.2, 0], "max": [1.5, 0.2, 3]}]}
        pose = np.eye(4)
        pose[:3, :3] = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # looks along x
        pose[2, 3] = 1.5
        rays = np.array([[[0, 0, 1], [0.5, 0, 1]]], float)
        self.assertTrue(np.allclose(boxes_depth(scene, pose, rays), [[1.0, 2.0]]))

    def test_splits_are_apart_and_complete(self):
        for kind in ("interleaved", "contiguous"):
            parts = split(50, kind)
            self.assertEqual(sorted(sum(parts.values(), [])), list(range(50)))


class Losses(unittest.TestCase):
    def test_u_is_best_where_it_is_the_mean_absolute_error(self):
        r = torch.distributions.Laplace(0.0, 0.2).sample((1, 1, 100, 200))
        depth = torch.ones_like(r)
        loss = lambda b: losses.supervised(r, torch.full_like(r, b), depth, (1, 0, 0)).item()
        best = r.abs().mean().item()
        self.assertLess(loss(best), min(loss(0.95 * best), loss(1.05 * best)))

    def test_unknown_depths_do_not_count(self):
        depth = torch.tensor([[[[0.0, 2.0], [2.0, 0.0]]]]).repeat(1, 1, 4, 4)
        log_depth = torch.full_like(depth, 5.0)
        known = torch.where(depth > 0, torch.log(depth.clamp(min=1e-3)), log_depth)
        self.assertEqual(losses.supervised(known, torch.full_like(depth, 0.5), depth, (0, 1, 1)).item(), 0.0)

    def test_a_common_factor_of_an_image_costs_extra(self):
        depth = torch.ones(2, 1, 8, 8)
        zeros, u = torch.zeros_like(depth), torch.full_like(depth, 0.5)
        checker = torch.ones_like(depth)
        checker[..., ::2] = -1
        scale = lambda r: losses.supervised(r, u, depth, (0, 0, 0, 1)).item()
        self.assertEqual(scale(zeros), 0.0)
        self.assertAlmostEqual(scale(0.3 * checker), 0.0, places=6)
        self.assertAlmostEqual(scale(zeros - 0.3), 0.3, places=6)

    def test_a_warp_to_the_other_eye_of_a_wall_shows_that_eyes_image(self):
        small = CANONICAL
        motion = np.linalg.inv(EUROC[1].body_from_camera) @ EUROC[0].body_from_camera
        left = painted(small.rays() * 2.0)
        right_camera = EUROC[1].resized(WIDTH, HEIGHT)
        directions = right_camera.rays() @ motion[:3, :3]
        origin = -motion[:3, :3].T @ motion[:3, 3]
        right = painted(origin + directions * ((2.0 - origin[2]) / directions[..., 2])[..., None])
        tensor = lambda image: torch.from_numpy(image)[None, None].float() / 255
        warp = losses.Warp(torch.from_numpy(small.rays()).float())
        arguments = (tensor(right), torch.from_numpy(motion)[None].float(), torch.from_numpy(EUROC[1].normalised)[None].float(),
                     torch.tensor([EUROC[1].distortion]))
        error = {}
        for depth in (1.6, 2.0, 2.5):
            seen, known = warp(torch.full((1, 1, 48, 80), float(np.log(depth))), *arguments)
            error[depth] = (seen - tensor(left)).abs()[known].mean().item()
        self.assertLess(error[2.0], 0.2 * min(error[1.6], error[2.5]))


class Figures(unittest.TestCase):
    def test_coverage_and_ause_of_a_model_that_is_right(self):
        draw = np.random.default_rng(3)
        reference = draw.uniform(1, 4, (4, 48, 80))
        scale = draw.uniform(0.02, 0.3, reference.shape)
        depth = reference * np.exp(draw.laplace(0, scale))
        right = metrics.laplace_quantile(0.6827)
        figures = metrics.uncertainty_figures(depth, scale, reference, right)
        for level in metrics.LEVELS:
            # Four standard errors of a share among 15 360.
            self.assertAlmostEqual(figures[f"coverage_{round(100 * level)}"], level, delta=4 * (level * (1 - level) / 15360) ** 0.5)
        self.assertAlmostEqual(metrics.fitted_sigma_per_u(depth, scale, reference), right, delta=0.03)
        self.assertLess(figures["ause_ratio"], 0.6)
        # A ranking by chance is as good as none; by the error itself, perfect.
        chance = metrics.uncertainty_figures(depth, draw.random(scale.shape), reference, right)
        self.assertAlmostEqual(chance["ause_ratio"], 1.0, delta=0.1)
        oracle = metrics.uncertainty_figures(depth, abs(depth - reference) / reference + 1e-9, reference, right)
        self.assertAlmostEqual(oracle["ause"], 0.0, delta=1e-6)

    def test_a_common_factor_is_aligned_away(self):
        reference = np.random.default_rng(1).uniform(1, 4, (2, 48, 80))
        figures = metrics.depth_figures(1.2 * reference, reference)
        self.assertAlmostEqual(figures["abs_rel"], 0.2)
        self.assertAlmostEqual(figures["abs_rel_aligned"], 0.0)
        self.assertAlmostEqual(figures["factor"], -np.log(1.2))
        self.assertAlmostEqual(figures["factor_sigma"], 0.0)

    def test_block_medians_are_those_of_each_block(self):
        draw = np.random.default_rng(2)
        depth = draw.uniform(1, 5, (97, 161)).astype(np.float32)
        depth[draw.random(depth.shape) < 0.5] = 0
        rows, columns, least = 12, 20, 0.5
        y, x = np.linspace(0, 97, rows + 1).astype(int), np.linspace(0, 161, columns + 1).astype(int)
        got = block_depth(depth, rows, columns, least)
        for i in range(rows):
            for j in range(columns):
                cell = depth[y[i] : y[i + 1], x[j] : x[j + 1]]
                known = cell[cell > 0]
                self.assertEqual(got[i, j], np.median(known) if known.size >= least * cell.size else 0)


class Network(unittest.TestCase):
    def test_shapes_ranges_and_folding(self):
        torch.manual_seed(0)
        network = DepthNetwork()
        network.train()
        with torch.no_grad():
            network(torch.rand(4, 1, HEIGHT, WIDTH))
            network.eval()
            image = torch.rand(1, 1, HEIGHT, WIDTH)
            (inverse, u), (log_depth, same_u) = network(image), network.log_depth_and_u(image)
            self.assertEqual(inverse.shape, (1, 1, HEIGHT // 4, WIDTH // 4))
            self.assertTrue(((u > 0) & (u < 1)).all() and torch.equal(u, same_u))
            self.assertLess((torch.log(inverse) + log_depth).abs().max(), 1e-5)
            self.assertLess((folded(network)(image)[0] - inverse).abs().max(), 1e-4)

    def test_an_exported_network_can_be_trained_on(self):
        torch.manual_seed(1)
        network = DepthNetwork()
        images = torch.rand(8, 1, HEIGHT, WIDTH)
        with torch.no_grad():
            network.train()
            network(images)
            network.eval()
            with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                file = Path(folder) / "some.onnx"
                torch.onnx.export(folded(network), (images[:1],), str(file), dynamo=False)
                again = DepthNetwork()
                unfolded(again, file, images)
            expected = network(images)[0]
            again.eval()
            self.assertLess((again(images)[0] - expected).abs().max(), 1e-4)
            # The normalisations are those of these images, so training goes on from the same function.
            again.train()
            self.assertLess((again(images)[0] - expected).abs().max(), 1e-4)

    def test_an_average_lies_between_two_networks_and_only_between_two_of_a_kind(self):
        def model(value, name="weight"):
            weight = onnx.numpy_helper.from_array(np.full(3, value, np.float32), name)
            return onnx.helper.make_model(onnx.helper.make_graph([], "g", [], [], [weight]))

        mixed = averaged(model(1.0), model(2.0), 0.7)
        np.testing.assert_allclose(onnx.numpy_helper.to_array(mixed.graph.initializer[0]), 1.7, rtol=1e-6)
        for share, other in ((0.5, model(2.0, "bias")), (1.5, model(2.0))):
            with self.assertRaises(ValueError):
                averaged(model(1.0), other, share)

    def test_augmentation_is_a_function_of_its_generator(self):
        image = torch.rand(3, 1, HEIGHT, WIDTH)
        one, two = (augment.photometric(image, torch.Generator().manual_seed(4)) for _ in range(2))
        self.assertTrue(torch.equal(one, two))
        self.assertTrue(((one >= 0) & (one <= 1)).all())


if __name__ == "__main__":
    unittest.main()
