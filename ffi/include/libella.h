/* libella for C. Made from ffi/src by `UPDATE_HEADER=1 cargo test -p libella-ffi`; do not edit. */

#ifndef LIBELLA_H
#define LIBELLA_H

#include <stddef.h>
#include <stdint.h>

// Corners of a plane's polygon at most.
#define LIBELLA_PLANE_CORNERS 12

// What became of a call.
typedef enum LibellaStatus {
  // Done.
  LIBELLA_STATUS_OK = 0,
  // A pointer is null.
  LIBELLA_STATUS_NULL = 1,
  // The memory is smaller than `libella_size` says.
  LIBELLA_STATUS_MEMORY_TOO_SMALL = 2,
  // The memory is not aligned to `libella_alignment`.
  LIBELLA_STATUS_MISALIGNED = 3,
  // The handle was not made by `libella_init`.
  LIBELLA_STATUS_NOT_A_HANDLE = 4,
  // A number of the configuration is unknown, not finite or out of range.
  LIBELLA_STATUS_BAD_CONFIG = 5,
  // A reading is NaN or infinite; nothing has changed.
  LIBELLA_STATUS_NOT_FINITE = 6,
  // A stamp is not newer than the last of its kind; nothing has changed.
  LIBELLA_STATUS_STALE = 7,
  // Width, height or stride of the image do not fit each other or the camera; nothing has changed.
  LIBELLA_STATUS_BAD_IMAGE = 8,
  // Inertial samples do not reach the image: push samples past it first. Nothing has changed.
  LIBELLA_STATUS_MISSING_IMU = 9,
  // No room for more inertial samples before the next image, or for as many tracks; nothing has changed.
  LIBELLA_STATUS_FULL = 10,
  // There is no pose: not initialised, or lost.
  LIBELLA_STATUS_NO_POSE = 11,
  // Refused for another reason; nothing has changed.
  LIBELLA_STATUS_REFUSED = 12,
} LibellaStatus;

// What became of an image.
typedef enum LibellaOutcome {
  // There was no new image to work on.
  LIBELLA_OUTCOME_NO_FRAME = 0,
  // Not initialised yet: waits for inertial samples.
  LIBELLA_OUTCOME_WAITS_FOR_IMU = 1,
  // Not initialised yet: waits for corners that can be followed.
  LIBELLA_OUTCOME_WAITS_FOR_TRACKS = 2,
  // Not initialised yet: the camera has not moved enough.
  LIBELLA_OUTCOME_WAITS_FOR_PARALLAX = 3,
  // Not initialised yet: scale needs acceleration.
  LIBELLA_OUTCOME_WAITS_FOR_EXCITATION = 4,
  // Not initialised yet: what the accelerometer measures is far from gravity.
  LIBELLA_OUTCOME_WAITS_FOR_GRAVITY = 5,
  // Not initialised yet: images and inertial samples contradict each other.
  LIBELLA_OUTCOME_WAITS_FOR_AGREEMENT = 6,
  // This image completed initialisation.
  LIBELLA_OUTCOME_INITIALISED = 7,
  // The newest pose is estimated.
  LIBELLA_OUTCOME_TRACKED = 8,
  // The same, and the image stays as a keyframe.
  LIBELLA_OUTCOME_NEW_KEYFRAME = 9,
  // Too few corners: the pose coasts on inertial samples.
  LIBELLA_OUTCOME_COASTED = 10,
  // Tracking was lost; the estimator starts over.
  LIBELLA_OUTCOME_LOST = 11,
  // Something newer than this header.
  LIBELLA_OUTCOME_OTHER = 12,
  // Not initialised yet: the start in motion is computed, a piece with each image.
  LIBELLA_OUTCOME_COMPUTES_ITS_START = 13,
} LibellaOutcome;

// What a plane is in a room.
typedef enum LibellaPlaneClass {
  // The lowest horizontal plane, and what is level with it.
  LIBELLA_PLANE_CLASS_FLOOR = 0,
  // Horizontal, high above the floor.
  LIBELLA_PLANE_CLASS_CEILING = 1,
  // Vertical.
  LIBELLA_PLANE_CLASS_WALL = 2,
  // Horizontal, as high above the floor as a table.
  LIBELLA_PLANE_CLASS_TABLE = 3,
  // Horizontal, none of these.
  LIBELLA_PLANE_CLASS_OTHER_PLANE = 4,
} LibellaPlaneClass;

// How the estimator is.
typedef enum LibellaHealth {
  // No pose yet.
  LIBELLA_HEALTH_INITIALISING = 0,
  // Images and inertial samples agree.
  LIBELLA_HEALTH_TRACKING = 1,
  // Too few corners: the pose coasts on inertial samples.
  LIBELLA_HEALTH_DEGRADED = 2,
  // Coasted too long; initialises anew with the next data.
  LIBELLA_HEALTH_LOST = 3,
} LibellaHealth;

// Capacities of an estimator, see `libella_size`.
typedef enum LibellaProfile {
  // Microcontroller: images of 160 x 120 px, 6 frames, 54 landmarks.
  LIBELLA_PROFILE_MICRO = 0,
  // Telephone: images up to 640 x 480 px, 8 frames, 150 landmarks.
  LIBELLA_PROFILE_MOBILE = 1,
  // Workstation: images up to 752 x 480 px, 16 frames, 640 landmarks.
  LIBELLA_PROFILE_DESKTOP = 2,
} LibellaProfile;

// How a lens bends rays.
typedef enum LibellaLens {
  // Pinhole with radial and tangential distortion k1 k2 p1 p2.
  LIBELLA_LENS_PINHOLE_RAD_TAN = 0,
  // Equidistant fisheye of Kannala and Brandt, k1 k2 k3 k4.
  LIBELLA_LENS_KANNALA_BRANDT = 1,
} LibellaLens;

// An estimator in memory of the caller.
typedef struct Libella Libella;

// What an estimator has to know, see `libella_config`.
typedef struct LibellaConfig {
  // A `LibellaProfile`.
  uint32_t profile;
  // A `LibellaLens`.
  uint32_t lens;
  // Width of the images, px.
  uint32_t width_px;
  // Height of the images, px.
  uint32_t height_px;
  // Focal lengths fx, fy, px.
  float focal_px[2];
  // Principal point cx, cy, px; the centre of the first pixel is 0, 0.
  float center_px[2];
  // Distortion, see the lens.
  float distortion[4];
  // Rotation from camera to body (IMU) coordinates, a Hamilton quaternion w x y z.
  float body_from_camera_wxyz[4];
  // Position of the camera in the body, m.
  float camera_in_body_m[3];
  // White noise of the angular rate, rad/s/sqrt(Hz), as in the datasheet.
  float gyro_noise_density;
  // White noise of the specific force, m/s^2/sqrt(Hz).
  float accel_noise_density;
  // Random walk of the gyro bias, rad/s^2/sqrt(Hz).
  float gyro_random_walk;
  // Random walk of the accelerometer bias, m/s^3/sqrt(Hz).
  float accel_random_walk;
  // Magnitude of gravity, m/s^2.
  float gravity_m_s2;
  // Standard deviation of a corner's position, px.
  float sigma_px;
  // An image becomes a keyframe when its corners have moved this far since the last one, rotation apart, px.
  float keyframe_parallax_px;
  // Images from one search for planes to the next, 30 is usual; landmarks are drawn to what is found. 0 seeks none.
  uint32_t planes_every;
} LibellaConfig;

// A corner in an image.
typedef struct LibellaTrack {
  // Its name: the same in every image that sees it, never used for another corner.
  uint32_t id;
  // Column, px, as the camera sees it (distorted).
  float x_px;
  // Row, px.
  float y_px;
} LibellaTrack;

// The newest state. World is z up and begins at the first pose.
typedef struct LibellaPose {
  // Time of the image that it belongs to, ns.
  int64_t stamp_ns;
  // Position of the body (IMU) in world, m.
  float position_in_world_m[3];
  // Rotation from body to world, a Hamilton quaternion w x y z.
  float world_from_body_wxyz[4];
  // Velocity in world, m/s.
  float velocity_in_world_m_s[3];
  // Bias of the angular rate, rad/s.
  float gyro_bias_rad_s[3];
  // Bias of the specific force, m/s^2.
  float accel_bias_m_s2[3];
  // Standard deviations of rotation (rad, body axes) and position (m, world axes).
  float sigma[6];
} LibellaPose;

// A plane of the room: `normal . x + offset_m = 0`.
typedef struct LibellaPlane {
  // Its name, as long as it is known; a later plane never has it.
  uint32_t id;
  // What it is.
  enum LibellaPlaneClass class_;
  // Unit normal in world.
  float normal_in_world[3];
  // Distance of the world's origin, with the sign of the side, m.
  float offset_m;
  // Landmarks that spoke for it when it was last found.
  uint32_t support;
  // Corners of its polygon that are filled in.
  uint32_t corner_count;
  // The polygon in world, m.
  float corners_in_world_m[LIBELLA_PLANE_CORNERS][3];
  // When it was first found, ns.
  int64_t first_seen_ns;
  // When it was last found, ns.
  int64_t last_seen_ns;
} LibellaPlane;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Bytes of memory that an estimator of a profile (a `LibellaProfile`) needs, its images included; 0 for an unknown profile.
size_t libella_size(uint32_t profile);

// Alignment of that memory, bytes.
size_t libella_alignment(void);

// A configuration with the defaults of the profile (a `LibellaProfile`): noise of an ADIS16448, gravity 9.81 m/s^2, a camera with the
// axes of the body. Image size, focal lengths, principal point and extrinsics are the caller's to fill in.
struct LibellaConfig libella_config(uint32_t profile);

// Makes an estimator in `length` bytes at `memory` and writes its handle to `handle`. The handle is valid as long as the memory is.
//
// # Safety
// `memory` is null or `length` bytes that nothing else uses; `config` and `handle` are null or valid.
enum LibellaStatus libella_init(void *memory,
                                size_t length,
                                const struct LibellaConfig *config,
                                struct Libella **handle);

// Takes one inertial sample: angular rate (rad/s) and specific force (m/s^2) in body axes. Push samples past an image first.
//
// # Safety
// `handle` is null or of `libella_init`; the arrays are null or have three numbers.
enum LibellaStatus libella_push_imu(struct Libella *handle,
                                    int64_t stamp_ns,
                                    const float *gyro_rad_s,
                                    const float *accel_m_s2);

// Takes an image of eight-bit grey pixels, `stride` bytes from row to row. The pixels are read during the call only.
//
// # Safety
// `handle` is null or of `libella_init`; `pixels` is null or has `stride * height_px` bytes, of which the last row may lack its end.
enum LibellaStatus libella_push_image(struct Libella *handle,
                                      int64_t stamp_ns,
                                      const uint8_t *pixels,
                                      uint32_t width_px,
                                      uint32_t height_px,
                                      size_t stride);

// Takes the corners of an image from a front end of the caller's own, at most as many as the profile has landmarks.
//
// # Safety
// `handle` is null or of `libella_init`; `tracks` is null (then `count` is taken for 0) or has `count` corners.
enum LibellaStatus libella_push_tracks(struct Libella *handle,
                                       int64_t stamp_ns,
                                       const struct LibellaTrack *tracks,
                                       size_t count);

// Works on the newest image, with at most `iterations` of the solver (4 is usual), and tells what became of it.
// A start in motion is spread over three to nine images, so that none takes much longer than one in flight.
//
// # Safety
// `handle` is null or of `libella_init`; `outcome` is null, when nobody wants to know, or valid.
enum LibellaStatus libella_step(struct Libella *handle, uint8_t iterations, enum LibellaOutcome *outcome);

// Writes the newest state to `pose`, once there is one.
//
// # Safety
// `handle` is null or of `libella_init`; `pose` is null or valid.
enum LibellaStatus libella_pose(struct Libella *handle, struct LibellaPose *pose);

// Writes the planes that are fit for use to `planes`, `capacity` of them at most, and their number, which may be larger, to `count`.
//
// # Safety
// `handle` is null or of `libella_init`; `planes` is null, or has room for `capacity`; `count` is null or valid.
enum LibellaStatus libella_planes(struct Libella *handle,
                                  struct LibellaPlane *planes,
                                  size_t capacity,
                                  size_t *count);

// Writes how the estimator is to `health`.
//
// # Safety
// `handle` is null or of `libella_init`; `health` is null or valid.
enum LibellaStatus libella_health(struct Libella *handle, enum LibellaHealth *health);

// Forgets every image and landmark and initialises anew with the next data.
//
// # Safety
// `handle` is null or of `libella_init`.
enum LibellaStatus libella_reset(struct Libella *handle);

// What a `LibellaStatus` means, in English.
const char *libella_status_text(uint32_t status);

// Defined by the program: what to do when this library has found a mistake in itself. Must not return.
extern void libella_panicked(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* LIBELLA_H */
