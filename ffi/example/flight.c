/* Flies a recording of the firmware (see firmware-sim/src/replay.rs) through the Micro profile in static memory, and prints a pose a
 * line: milliseconds since the first sample, position (m), quaternion x y z w, each as the hexadecimal bits of its float.
 *
 *   cc -std=c11 -Wall -Wextra -Iffi/include ffi/example/flight.c -Ltarget/release -lella -o flight && ./flight RECORDING
 */
#include <libella.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WIDTH 160
#define HEIGHT 120

/* More than libella_size(LIBELLA_PROFILE_MICRO), which is checked below. */
static _Alignas(16) unsigned char memory[112 * 1024];

struct sample {
  int64_t stamp_ns;
  float gyro_rad_s[3], accel_m_s2[3];
};

static void must(enum LibellaStatus status, const char *what) {
  if (status == LIBELLA_STATUS_OK) return;
  fprintf(stderr, "%s: %s\n", what, libella_status_text((uint32_t)status));
  exit(1);
}

static void must_read(void *to, size_t bytes, FILE *file) {
  if (fread(to, 1, bytes, file) == bytes) return;
  fprintf(stderr, "the recording is cut off\n");
  exit(1);
}

static uint32_t bits(float value) {
  uint32_t word;
  memcpy(&word, &value, sizeof word);
  return word;
}

/* Little-endian machines only: the numbers are read as they lie in the file. */
int main(int count, char **arguments) {
  FILE *file = count >= 2 ? fopen(arguments[1], "rb") : NULL;
  int with_planes = count == 3 && strcmp(arguments[2], "planes") == 0;
  char magic[8];
  uint32_t counts[7]; /* samples, images, depth maps, width, height, columns and rows of a depth map */
  float numbers[19];
  if (!file) {
    fprintf(stderr, "usage: flight RECORDING [planes]\n");
    return 1;
  }
  must_read(magic, sizeof magic, file);
  must_read(counts, sizeof counts, file);
  must_read(numbers, sizeof numbers, file);
  if (memcmp(magic, "libella2", 8) != 0 || counts[3] != WIDTH || counts[4] != HEIGHT) {
    fprintf(stderr, "not a recording of %d x %d px\n", WIDTH, HEIGHT);
    return 1;
  }

  LibellaConfig config = libella_config(LIBELLA_PROFILE_MICRO);
  config.width_px = WIDTH;
  config.height_px = HEIGHT;
  memcpy(config.focal_px, numbers, sizeof config.focal_px);
  memcpy(config.center_px, numbers + 2, sizeof config.center_px);
  memcpy(config.distortion, numbers + 4, sizeof config.distortion);
  memcpy(config.body_from_camera_wxyz, numbers + 8, sizeof config.body_from_camera_wxyz);
  memcpy(config.camera_in_body_m, numbers + 12, sizeof config.camera_in_body_m);
  config.gyro_noise_density = numbers[15];
  config.accel_noise_density = numbers[16];
  config.planes_every = with_planes ? 10 : 0;
  config.gyro_random_walk = numbers[17];
  config.accel_random_walk = numbers[18];

  Libella *estimator;
  fprintf(stderr, "%zu bytes\n", libella_size(LIBELLA_PROFILE_MICRO));
  must(libella_init(memory, sizeof memory, &config, &estimator), "init");

  /* Samples lie before the images in the file; they are pushed as their time comes. */
  struct sample *samples = calloc(counts[0], sizeof *samples);
  if (!samples) return 1;
  for (uint32_t i = 0; i < counts[0]; i++) {
    must_read(&samples[i].stamp_ns, 8, file);
    must_read(samples[i].gyro_rad_s, 12, file);
    must_read(samples[i].accel_m_s2, 12, file);
  }
  static _Alignas(16) uint8_t pixels[WIDTH * HEIGHT];
  uint32_t next = 0;
  for (uint32_t i = 0; i < counts[1]; i++) {
    int64_t stamp_ns;
    must_read(&stamp_ns, 8, file);
    must_read(pixels, sizeof pixels, file);
    for (; next < counts[0] && samples[next].stamp_ns <= stamp_ns; next++)
      must(libella_push_imu(estimator, samples[next].stamp_ns, samples[next].gyro_rad_s, samples[next].accel_m_s2), "imu");
    must(libella_push_image(estimator, stamp_ns, pixels, WIDTH, HEIGHT, WIDTH), "image");
    LibellaOutcome outcome;
    must(libella_step(estimator, 4, &outcome), "step");
    LibellaPose pose;
    LibellaStatus status = libella_pose(estimator, &pose);
    if (status == LIBELLA_STATUS_NO_POSE) continue;
    must(status, "pose");
    const float *p = pose.position_in_world_m, *q = pose.world_from_body_wxyz;
    printf("%lld %08x %08x %08x %08x %08x %08x %08x\n", (long long)((stamp_ns - samples[0].stamp_ns) / 1000000), bits(p[0]),
           bits(p[1]), bits(p[2]), bits(q[1]), bits(q[2]), bits(q[3]), bits(q[0]));
  }

  LibellaPlane planes[4];
  size_t found;
  must(libella_planes(estimator, planes, 4, &found), "planes");
  for (size_t i = 0; i < found && i < 4; i++)
    fprintf(stderr, "plane %u, class %u, %u corners, offset %.3f m\n", (unsigned)planes[i].id, (unsigned)planes[i].class_,
            (unsigned)planes[i].corner_count, (double)planes[i].offset_m);
  if ((found > 0) != with_planes) {
    fprintf(stderr, "%zu planes\n", found);
    return 1;
  }

  /* What is wrong is refused with a reason, and changes nothing. */
  float nothing[3] = {0, 0, 0};
  LibellaHealth before, after;
  must(libella_health(estimator, &before), "health");
  int refused = libella_push_imu(estimator, 0, nothing, nothing) == LIBELLA_STATUS_STALE &&
                libella_push_imu(NULL, 0, nothing, nothing) == LIBELLA_STATUS_NULL &&
                libella_planes(estimator, planes, 4, NULL) == LIBELLA_STATUS_NULL &&
                libella_push_image(estimator, 0, pixels, WIDTH, HEIGHT, WIDTH - 1) == LIBELLA_STATUS_BAD_IMAGE &&
                libella_push_image(estimator, 0, pixels, WIDTH - 1, HEIGHT, WIDTH) == LIBELLA_STATUS_BAD_IMAGE &&
                libella_init(memory, 100, &config, &estimator) == LIBELLA_STATUS_MEMORY_TOO_SMALL &&
                libella_step((Libella *)pixels, 4, NULL) != LIBELLA_STATUS_OK;
  must(libella_health(estimator, &after), "health");
  if (!refused || before != after) {
    fprintf(stderr, "a mistake was not refused\n");
    return 1;
  }
  free(samples);
  fclose(file);
  return 0;
}
