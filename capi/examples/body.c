// Measures the body of an exact model, and locates a point next to the minimum corner of its
// bounds:
//
//     body model.goblin

#include <stdio.h>

#include "spinney.h"

static int fail(const char *doing) {
  fprintf(stderr, "body: cannot %s: %s\n", doing, spinney_error());
  return 1;
}

int main(int count, char **words) {
  if (count != 2) {
    fprintf(stderr, "usage: body MODEL.goblin\n");
    return 2;
  }
  spinney_model *model = NULL;
  if (spinney_model_open(words[1], 0, &model) != SPINNEY_OK) {
    return fail("open");
  }
  int status = 1;
  spinney_mass mass;
  double bounds[6], distance;
  int8_t place;
  if (spinney_model_measure(model, &mass, sizeof mass) != SPINNEY_OK) {
    fail("measure");
  } else if (spinney_model_bounds(model, &bounds) != SPINNEY_OK) {
    fail("find the bounds");
  } else {
    // Next to the minimum corner.
    const double point[3] = {bounds[0] + 0.1, bounds[1] + 0.1, bounds[2] + 0.1};
    if (spinney_model_locate(model, point, 1, &place, 1) != SPINNEY_OK ||
        spinney_model_distance(model, point, 1, &distance, 1) != SPINNEY_OK) {
      fail("query");
    } else {
      printf("volume %.17g\narea %.17g\n", mass.volume, mass.area);
      printf("point %s\ndistance %.17g\n",
             place == SPINNEY_INSIDE ? "inside" : place == SPINNEY_OUTSIDE ? "outside" : "boundary", distance);
      status = 0;
    }
  }
  spinney_model_close(model);
  return status;
}
