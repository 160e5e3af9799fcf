// Lists the layers of a file: number, name, depth and the mean of the first channel of each:
//
//     layers stack.goblin

#include <stdio.h>

#include "spinney.h"

static int fail(const char *doing) {
  fprintf(stderr, "layers: cannot %s: %s\n", doing, spinney_error());
  return 1;
}

static int print_layer(const spinney_dataset *file, size_t number) {
  const char *name = spinney_layer_name(file, number);
  spinney_dataset *layer = NULL;
  if (name == NULL || spinney_open_layer(file, name, 0, &layer) != SPINNEY_OK) {
    return fail("open a layer");
  }
  int status = 0;
  spinney_info info;
  spinney_statistics of;
  if (spinney_describe(layer, &info, sizeof info) != SPINNEY_OK ||
      spinney_statistics_of(layer, NULL, &of) != SPINNEY_OK) {
    status = fail("query");
  } else {
    printf("%zu %s %u %.17g\n", number, name, (unsigned)info.depth, of.channels[0].mean);
  }
  spinney_close(layer);
  return status;
}

int main(int count, char **words) {
  if (count != 2) {
    fprintf(stderr, "usage: layers FILE\n");
    return 2;
  }
  spinney_dataset *file = NULL;
  if (spinney_open(words[1], NULL, 0, 0, &file) != SPINNEY_OK) {
    return fail("open");
  }
  size_t layers = 0;
  int status = spinney_layer_count(file, &layers) == SPINNEY_OK ? 0 : fail("count");
  for (size_t number = 0; number < layers && status == 0; ++number) {
    status = print_layer(file, number);
  }
  spinney_close(file);
  return status;
}
