// Builds an exact model of a cube from arrays, prints its volume, and cuts it half way up:
//
//     cube model.goblin [open|twice]
//
// With `open` a triangle is missing: the surface bounds no body, and the locations are reported.
// With `twice` there is a second cube, which overlaps half of the first. Their intersection counts
// as outside: that changes the volume, and the library warns.

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "spinney.h"

static int fail(const char *doing) {
  fprintf(stderr, "cube: cannot %s: %s\n", doing, spinney_error());
  return 1;
}

// Prints the rings of a model's section by the plane z = 1.
static int cut(const spinney_model *model) {
  const double point[3] = {0, 0, 1}, normal[3] = {0, 0, 1};
  size_t ring_count, point_count;
  if (spinney_model_section(model, point, normal, NULL, 0, sizeof(spinney_ring), &ring_count, NULL, 0, &point_count) != SPINNEY_OK) {
    return fail("count the rings");
  }
  spinney_ring *rings = malloc(ring_count * sizeof *rings);
  double *points = malloc(3 * point_count * sizeof *points);
  int status = 1;
  if (rings == NULL || points == NULL) {
    fprintf(stderr, "cube: no memory\n");
  } else if (spinney_model_section(model, point, normal, rings, ring_count, sizeof *rings, &ring_count, points, point_count, &point_count) != SPINNEY_OK) {
    fail("cut the model");
  } else {
    unsigned long long first = 0;
    for (size_t ring = 0; ring < ring_count; ring++) {
      printf("ring %zu of polygon %llu: %llu points, area %g\n", ring, (unsigned long long)rings[ring].polygon, rings[ring].end - first, rings[ring].area);
      first = rings[ring].end;
    }
    status = 0;
  }
  free(rings);
  free(points);
  return status;
}

int main(int count, char **words) {
  if (count < 2) {
    fprintf(stderr, "usage: cube MODEL.goblin [open|twice]\n");
    return 2;
  }
  static const double vertices[] = {0, 0, 0, 2, 0, 0, 0, 2, 0, 2, 2, 0, 0, 0, 2, 2, 0, 2, 0, 2, 2, 2, 2, 2};
  static const uint32_t corners[] = {0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5};
  const char *word = count > 2 ? words[2] : "";
  double shifted[24];
  for (int i = 0; i < 24; i++) {
    shifted[i] = vertices[i] + (i % 3 == 0);
  }
  spinney_mesh mesh = {0};
  mesh.name = "cube";
  mesh.vertices = vertices;
  mesh.vertex_count = 8;
  mesh.corners = corners;
  mesh.corner_count = strcmp(word, "open") == 0 ? 33 : 36;
  mesh.corner_size = sizeof corners[0];
  spinney_mesh meshes[2] = {mesh, mesh};
  meshes[1].name = "other";
  meshes[1].vertices = shifted;
  spinney_mesh_options options = {0};
  const bool is_twice = strcmp(word, "twice") == 0;
  options.repair = is_twice;
  options.inside = is_twice ? SPINNEY_INSIDE_ODD : options.inside;
  if (spinney_model_build(meshes, is_twice ? 2 : 1, sizeof mesh, &options, sizeof options, words[1], NULL, 0) != SPINNEY_OK) {
    return fail("build");
  }
  if (*spinney_warnings() != 0) {
    fprintf(stderr, "cube: %s\n", spinney_warnings());
  }
  spinney_model *model = NULL;
  if (spinney_model_open(words[1], 0, &model) != SPINNEY_OK) {
    return fail("open");
  }
  spinney_mass mass;
  int status = 1;
  if (spinney_model_measure(model, &mass, sizeof mass) != SPINNEY_OK) {
    fail("measure");
  } else {
    printf("volume %g\n", mass.volume);
    status = cut(model);
  }
  spinney_model_close(model);
  return status;
}
