// Writes a window of a Spinney file as a greyscale image (PGM):
//
//     tile map.goblin LEVEL X Y WIDTH HEIGHT > tile.pgm

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "spinney.h"

static int fail(const char *doing) {
  fprintf(stderr, "tile: cannot %s: %s\n", doing, spinney_error());
  return 1;
}

int main(int count, char **words) {
  if (count != 7) {
    fprintf(stderr, "usage: tile FILE LEVEL X Y WIDTH HEIGHT > TILE.pgm\n");
    return 2;
  }
  spinney_dataset *map = NULL;
  if (spinney_open(words[1], NULL, 0, 0, &map) != SPINNEY_OK) {
    return fail("open");
  }
  spinney_info info;
  if (spinney_describe(map, &info, sizeof info) != SPINNEY_OK) {
    return fail("describe");
  }
  if (info.axes != 2 || info.sample != SPINNEY_U8) {
    fprintf(stderr, "%s: is not a raster of bytes\n", words[1]);
    spinney_close(map);
    return 1;
  }
  fprintf(stderr, "%" PRIu64 " x %" PRIu64 " cells, %" PRIu32 " levels\n", info.size[0], info.size[1], info.depth);
  const uint32_t level = (uint32_t)strtoul(words[2], NULL, 10);
  const spinney_box window = {
      .start = {strtoull(words[3], NULL, 10), strtoull(words[4], NULL, 10), 0},
      .size = {strtoull(words[5], NULL, 10), strtoull(words[6], NULL, 10), 1},
  };
  const size_t cells = (size_t)(window.size[0] * window.size[1]);
  const size_t bytes = cells * info.cell_size;
  uint8_t *samples = malloc(bytes > 0 ? bytes : 1);
  int status = 1;
  if (samples == NULL) {
    fprintf(stderr, "tile: no memory for %zu bytes\n", bytes);
  } else if (spinney_read(map, level, &window, info.has_nodata ? info.nodata : 0.0, samples, bytes, NULL, 0) != SPINNEY_OK) {
    status = fail("read");
  } else {
    printf("P5\n%" PRIu64 " %" PRIu64 "\n255\n", window.size[0], window.size[1]);
    for (size_t cell = 0; cell < cells; cell++) {
      putchar(samples[cell * info.cell_size]);
    }
    status = fflush(stdout) == 0 ? 0 : 1;
  }
  free(samples);
  spinney_close(map);
  return status;
}
