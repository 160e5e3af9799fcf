// Spinney files from C. Made by cbindgen from the sources in capi/src: do not edit.
//
// Every function that can fail returns a spinney_status; spinney_error() then has the text, for the calling thread and until
// its next call. Calls that make files may warn: spinney_warnings(). Nothing is printed, and no call ends the program.
//
// Pointers: what a function reads or writes through a pointer must be there for as long as the call takes; texts are
// zero-terminated UTF-8 (paths are the bytes that the system takes). NULL where something is needed is SPINNEY_INVALID.
// Sizes of buffers are always passed, and one that is too small is SPINNEY_INVALID, with nothing written to it.
//
// Threads: any number of them may use a dataset or model at once, but for spinney_refresh(), spinney_close() and
// spinney_model_close(), which need it alone.
//
// Files are mapped. Where others may cut a file short while it is read, or it is on a network folder, SPINNEY_POSITIONED
// reads it instead: a page of a mapping that is lost is a signal (SIGBUS), which a library cannot catch for its caller.

#pragma once

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// For spinney_open(): read at positions, instead of mapping the file.
#define SPINNEY_POSITIONED 1

// For spinney_open_layer(): on the cells of the dataset that it is opened from.
#define SPINNEY_ALIGNED 1

// Place of a point, by spinney_model_locate(): outside of the body.
#define SPINNEY_OUTSIDE -1

// On a face, an edge or a vertex.
#define SPINNEY_BOUNDARY 0

// Inside the body.
#define SPINNEY_INSIDE 1

// For `inside` of spinney_mesh_options: inside are the places that a surface goes around, as cells have it.
#define SPINNEY_INSIDE_NONZERO 0

// Places that a surface goes around once or more.
#define SPINNEY_INSIDE_POSITIVE 1

// Places that a surface goes around an odd number of times.
#define SPINNEY_INSIDE_ODD 2

// The outcome of a call.
typedef enum {
  // It is done.
  SPINNEY_OK = 0,
  // An argument makes no sense, by itself or for this file: also NULL, and buffers of the wrong size.
  SPINNEY_INVALID = 1,
  // There is no such file.
  SPINNEY_NOT_FOUND = 2,
  // The system refused an operation on a file.
  SPINNEY_IO = 3,
  // The file is damaged, or not what its name says.
  SPINNEY_CORRUPT = 4,
  // The file, or the call, asks for something that is not supported.
  SPINNEY_UNSUPPORTED = 5,
  // The file was changed by somebody else while it was read.
  SPINNEY_CHANGED = 6,
  // There is not enough memory, or not enough is allowed.
  SPINNEY_MEMORY = 7,
  // A function of the caller's has asked to stop.
  SPINNEY_STOPPED = 8,
  // A mistake in the library itself. The dataset can still be closed.
  SPINNEY_INTERNAL = 9,
} spinney_status;

// Type of a sample; the machine's own byte order is little-endian wherever Spinney runs.
typedef enum {
  SPINNEY_U8 = 0,
  SPINNEY_U16 = 1,
  SPINNEY_I16 = 2,
  SPINNEY_U32 = 3,
  SPINNEY_I32 = 4,
  SPINNEY_F32 = 5,
  SPINNEY_F64 = 6,
  SPINNEY_I8 = 7,
  SPINNEY_U64 = 8,
  SPINNEY_I64 = 9,
} spinney_sample_type;

// A file, or a view of one.
typedef struct spinney_dataset spinney_dataset;

// An exact model: the boundary of a body, kept as it is and not as cells.
typedef struct spinney_model spinney_model;

// Numbers of a dataset.
typedef struct {
  // 2 are quadtrees (pictures), 3 are octrees (volumes and solids).
  uint32_t axes;
  // Type of a sample.
  spinney_sample_type sample;
  // Samples of a cell, 1 to 4.
  uint32_t channels;
  // Bytes of a cell: those of all its samples.
  uint32_t cell_size;
  // The level of the cells. Level 0 is the whole space as one node, each level below is twice as fine along each axis.
  uint32_t depth;
  // Number of the channel that is opacity, or -1.
  int32_t alpha;
  // Size in cells along x, y and z; z is 1 in quadtrees.
  uint64_t size[3];
  // Place of the cells in the world: rows x, y, z of the matrix that takes x, y, z, 1 in cells there. Cell 0 spans 0 to 1.
  double matrix[12];
  // The number that VOID had in the input, if has_nodata: the nearest double of it (see spinney_nodata()).
  double nodata;
  bool has_nodata;
  // Whether the matrix says something.
  bool has_georeference;
  // Whether values are classes.
  bool is_categorical;
  // Whether the file is edited and has commits.
  bool is_autumnal;
  // Number of the commit, or 0.
  uint64_t commit;
} spinney_info;

// A box of cells of a level; z is 0 and 1 in quadtrees.
typedef struct {
  // First cell along x, y and z.
  uint64_t start[3];
  // Cells along x, y and z.
  uint64_t size[3];
} spinney_box;

// Cells of a box where they stand in a mapped file. None of them is VOID.
typedef struct {
  // The first cell; not aligned, and there until the dataset is closed or refreshed.
  const void *samples;
  // Bytes from a cell to that in the next row.
  size_t row_stride;
  // Bytes from a cell to that in the next layer.
  size_t layer_stride;
} spinney_view;

// Statistics of one channel; the standard deviation is that of the population.
typedef struct {
  // Cells that have a sample. All other numbers are not numbers if there are none.
  uint64_t cells;
  double min;
  double max;
  double mean;
  double standard_deviation;
} spinney_channel_statistics;

// Statistics of a box of cells.
typedef struct {
  // Cells that are not VOID.
  uint64_t cells;
  // Cells that are VOID.
  uint64_t void_cells;
  // Classes that spinney_classes() has.
  uint64_t classes;
  spinney_channel_statistics channels[4];
} spinney_statistics;

// A block of cells that is handed to a function.
typedef struct {
  // Its cells, of the level that was asked for.
  spinney_box cells;
  // Samples as spinney_read() writes them, there until the function returns.
  const uint8_t *samples;
  // A byte for each cell: 1 where there is a value.
  const uint8_t *valid;
} spinney_block;

// A function that takes blocks; anything but 0 asks to stop.
typedef int (*spinney_take_block)(void *user, const spinney_block *block);

// Numbers of an exact model.
typedef struct {
  // Number of faces.
  uint64_t faces;
  // Number of the octree's nodes.
  uint64_t nodes;
  // Number of the parts to which faces belong.
  uint64_t parts;
  // Levels of the octree.
  uint32_t depth;
  // Bits of the grid's coordinates: there are 2^bits points along each axis.
  uint32_t bits;
  // Width of the grid's steps in the world.
  double step;
  // The grid's least point in the world.
  double origin[3];
} spinney_model_info;

// Measures of an exact model, of a density of 1: exact numbers for its grid, each rounded once (but for the area).
typedef struct {
  double volume;
  double area;
  // Centre of gravity; zeros if has_centre is false, since there is no volume.
  double centre[3];
  // Integrals of the products of two coordinates about the centre, row by row.
  double second_moments[9];
  // Inertia tensor about the centre, row by row.
  double inertia[9];
  bool has_centre;
} spinney_mass;

// What a ray meets first.
typedef struct {
  // How far away it is, in lengths of the ray's direction.
  double distance;
  // The place in the world.
  double point[3];
  // Number of the face.
  uint64_t face;
  // Number of its part.
  uint32_t part;
  // Whether the ray comes from outside.
  bool is_entry;
  // Whether anything is met; else the rest is zeros.
  bool is_hit;
} spinney_hit;

// A mesh in the caller's memory: vertices, and faces over them. Zeros and NULL are for what there is not, as in
// `spinney_mesh mesh = {0};`.
typedef struct {
  // Name, for errors, and of the only part of a mesh without `part_names`; NULL for "mesh".
  const char *name;
  // Coordinates of the vertices: x, y and z of each.
  const double *vertices;
  // Number of vertices.
  size_t vertex_count;
  // Colours: red, green and blue of each vertex; NULL for none.
  const uint8_t *colours;
  // Corners of all faces, by the numbers of their vertices from 0: counterclockwise seen from outside.
  const void *corners;
  // Number of corners: three of each triangle, where there are no `ring_ends`.
  size_t corner_count;
  // Bytes of each of these numbers: 4 (uint32_t) or 8 (uint64_t).
  size_t corner_size;
  // Ends of the rings in `corners`, ascending, of faces that are polygons of any number of corners.
  const uint64_t *ring_ends;
  // Number of rings; 0 where all faces are triangles.
  size_t ring_count;
  // Ends of the faces among the rings, ascending, where faces have holes: the first ring of each is its outer one, its holes go the
  // other way round.
  const uint64_t *face_ends;
  // Number of faces that `face_ends` has; 0 where each ring is a face.
  size_t face_count;
  // Number of the part of each face, from 0; NULL where all are of the first.
  const uint32_t *parts;
  // Names of the parts.
  const char *const *part_names;
  // Attributes of the parts: of each a JSON object such as {"attributes":{"height":5}}, or NULL. NULL where no part has any.
  const char *const *part_attributes;
  // Number of parts that have names.
  size_t part_count;
} spinney_mesh;

// Options for building an exact model. Zeros are for what is usual, as in `spinney_mesh_options options = {0};`.
typedef struct {
  // Width of the grid's steps, to which corners are moved; 0 for the least power of two that leaves about 2^24 steps along the
  // longest side.
  double snap;
  // Bytes of memory beside a copy of the meshes; 0 for 256 MiB. What does not fit goes to a temporary file beside the output.
  uint64_t memory;
  // The rule by which a repair tells what is inside: SPINNEY_INSIDE_NONZERO, SPINNEY_INSIDE_POSITIVE or SPINNEY_INSIDE_ODD.
  uint32_t inside;
  // Whether open surfaces are closed by triangles over their boundaries.
  bool close;
  // Whether surfaces that pass through themselves, lie on themselves or are inside out are resolved.
  bool repair;
  // Unit of length, such as "mm"; NULL if it is not known.
  const char *unit;
  // Definition of the coordinate system, such as "EPSG:25832"; NULL if it is not known.
  const char *crs;
} spinney_mesh_options;

// Counts of an exact model that was built.
typedef struct {
  // Faces that were read, without those that have fewer than three different corners.
  uint64_t read;
  // Faces of the model.
  uint64_t faces;
  // Faces that are points or lines on the grid, and were left out.
  uint64_t collapsed;
  // Faces without area on the grid, which stay and bound nothing.
  uint64_t slivers;
  // Faces that the grid has bent, cut into triangles.
  uint64_t cut;
  // Faces that cross themselves, cut into triangles.
  uint64_t fanned;
  // Boundaries that were closed, and the triangles that close them.
  uint64_t closed_boundaries;
  uint64_t closing_triangles;
  // Faces that a repair has divided or taken away, those of them that bounded nothing, and bodies that it has turned.
  uint64_t repaired_faces;
  uint64_t lost_faces;
  uint64_t turned_bodies;
  // Volumes of a repaired surface: as it came, what is inside now, and what cells would have inside; zeros where nothing is repaired.
  double volume_before;
  double volume;
  double cells_volume;
  // The farthest that a corner was moved to the grid.
  double displacement;
  // Width of the grid's steps.
  double step;
} spinney_mesh_report;

// Numbers of the entities of a shell: a surface that hangs together.
typedef struct {
  uint64_t vertices;
  uint64_t edges;
  uint64_t faces;
  // Rings beside the first of each face: holes in faces.
  uint64_t inner_rings;
  // 0 of a closed shell.
  uint64_t boundaries;
  // Number of handles; -1 where that is no number.
  int64_t genus;
  // Volume that it encloses, rounded once; negative of a cavity, so that a body is a shell of more than 0.
  double volume;
} spinney_shell;

// A ring of a section.
typedef struct {
  // Number of its polygon, from 0. Rings of one follow each other: the outer one, counterclockwise as seen from where the plane's normal
  // points to, and then the holes, clockwise.
  uint64_t polygon;
  // End of its points, which begin where those of the ring before end. The last of them is the first one again.
  uint64_t end;
  // Area of the polygon without its holes; 0 of holes, so that the sum is the section's.
  double area;
} spinney_ring;

// Reads parts of a file: `count` of them, the first from `offsets[0]` on, `lengths[0]` bytes to `buffers[0]`, and so on; `user` is what
// spinney_open_parts() was given. Returns 0, or another number if one of them cannot be read. All parts of a call are needed before
// anything goes on, so that they are best asked for at the same time. May be called by any thread, and by several at once.
typedef int32_t (*spinney_fetch)(void *user,
                                 size_t count,
                                 const uint64_t *offsets,
                                 const size_t *lengths,
                                 uint8_t *const *buffers);

// Called when nothing of a file is read any more, with what spinney_open_parts() was given.
typedef void (*spinney_release)(void *user);

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The text of the last failure in this thread: which file, what was found, what was expected. Empty if there was none; it is
// there until the thread's next call that fails.
const char *spinney_error(void);

// The library's version.
const char *spinney_version(void);

// Warnings of this thread's last call of spinney_model_build() or spinney_model_combine(), a line for each, beginning with the file that it is
// about: what users should know of a file that was made all the same, such as a repair that changes the volume by more than a hundredth, or values of
// faces that are not kept. Empty if there was nothing; it is there until the thread's next such call.
const char *spinney_warnings(void);

// Changes how many bytes of packed segments, unpacked, all open files together keep in memory for the next use: 64 MiB if nothing is said.
void spinney_set_cache_memory(uint64_t bytes);

// Opens a tree file of either format and any type. `map.autumn@12` is commit 12 of `map.autumn`, `stack.goblin:B08` the layer `B08`
// of `stack.goblin`, whose first one is opened where none is named. `steps` are those of a view, as `spinney transform` takes them
// ("rotate=30", "crop"), `step_count` of them; NULL and 0 for the file as it is. `flags` is 0 or SPINNEY_POSITIONED. The dataset is
// to be closed by spinney_close().
//
// Costs a few pages, whatever the file's size.
spinney_status spinney_open(const char *path,
                            const char *const *steps,
                            size_t step_count,
                            uint32_t flags,
                            spinney_dataset **dataset);

// Closes a dataset; NULL is nothing to close.
void spinney_close(spinney_dataset *dataset);

// Moves on to the newest commit of a file that is edited; `is_newer` (which may be NULL) tells whether there was one. A
// dataset that was opened at a certain commit, and a view, stays as it is.
spinney_status spinney_refresh(spinney_dataset *dataset,
                               bool *is_newer);

// Fails with SPINNEY_CHANGED if the file was overwritten or cut short since it was opened: answers may then be of the one
// state or the other. Worth a call at the end of long work.
spinney_status spinney_check_unchanged(const spinney_dataset *dataset);

// Tells a dataset's numbers. `info_size` is `sizeof(spinney_info)`, so that a later version can have more.
spinney_status spinney_describe(const spinney_dataset *dataset,
                                spinney_info *info,
                                size_t info_size);

// Size of a level in its cells, along x, y and z; a level below the cells counts as theirs.
spinney_status spinney_level_size(const spinney_dataset *dataset,
                                  uint32_t level,
                                  uint64_t (*size)[3]);

// All that is known of a dataset beside its numbers, as JSON: "name" (of the layer), "time", "crs" (its form and definition as it came;
// its "text" for other programs, which is "EPSG:4326" or the like, or else WKT 2; where it cannot be said so, "problem" tells why, and the
// text is null, or WKT 1, PROJJSON or PROJ's words as they came), "bands" (name, unit, scale, offset of each), "categories" (names by
// value), "palette" (red, green, blue, opacity by value), "tags", "scoped_tags", "provenance". The text belongs to the dataset, and is
// there until that is closed or refreshed. NULL if the dataset is NULL.
const char *spinney_metadata(const spinney_dataset *dataset);

// Tells how many layers the dataset's file has, whichever of them the dataset is; 1 of a view.
spinney_status spinney_layer_count(const spinney_dataset *dataset, size_t *count);

// Name of a layer of the dataset's file, by its number from 0; may be empty where there is one layer alone. The text belongs to the
// dataset, and is there until that is closed or refreshed. NULL if there is no layer of that number, or no dataset.
const char *spinney_layer_name(const spinney_dataset *dataset,
                               size_t number);

// Opens another layer of a dataset's file, at the same commit: `layer` is its name, or else its number from 0 in digits. The file is
// not opened again; each of the two is to be closed by spinney_close(), in any order. `flags` is 0 or SPINNEY_ALIGNED: then the layer
// has the dataset's size and depth, and its cells, if they are larger, are repeated. SPINNEY_UNSUPPORTED of a view: name the layer in
// spinney_open() instead.
spinney_status spinney_open_layer(const spinney_dataset *dataset,
                                  const char *layer,
                                  uint32_t flags,
                                  spinney_dataset **opened_layer);

// Reads a box of cells of a level: x fastest, then y, then z, the samples of a cell together. `samples_size` is the bytes of
// all of them, `cells * cell_size`; they need not be aligned. Cells that are VOID, or outside, get `fill` in every channel. `valid` may be NULL (with
// `valid_size` 0), else it has a byte for each cell: 1 where there is a value, 0 where not.
//
// Takes time by the cells of the box, whatever lies below them.
spinney_status spinney_read(const spinney_dataset *dataset,
                            uint32_t level,
                            const spinney_box *cells,
                            double fill,
                            void *samples,
                            size_t samples_size,
                            uint8_t *valid,
                            size_t valid_size);

// Shows a box of cells of a level where it stands in the file, without a copy: the samples of a cell together, the cells of a row
// one behind the other. That can be if the file is a mapped Goblin file and no view, and has the box in one dense block: where no two
// cells are alike, boxes within aligned ones of up to 256 x 256 cells (16 x 16 x 16 in octrees). SPINNEY_UNSUPPORTED if not:
// spinney_read() reads all boxes.
spinney_status spinney_view_of(const spinney_dataset *dataset,
                               uint32_t level,
                               const spinney_box *cells,
                               spinney_view *view);

// Reads single cells of a level: `cells` has x, y and z of each, `count` of them, in any order. `samples` has room for
// `count * channels` numbers; `valid` (which may be NULL) for `count` flags, as in spinney_read(). Cells that are VOID, or outside,
// are not a number. Integers of 64 bits are the nearest doubles: spinney_point_samples() has them exactly. Much faster than one call for each.
spinney_status spinney_points(const spinney_dataset *dataset,
                              uint32_t level,
                              const uint64_t (*cells)[3],
                              size_t count,
                              double *samples,
                              uint8_t *valid);

// Exact statistics of a box of cells of the deepest level; of all of them if `cells` is NULL. Takes time by the box's border.
spinney_status spinney_statistics_of(const spinney_dataset *dataset,
                                     const spinney_box *cells,
                                     spinney_statistics *statistics);

// Classes of a box of cells, as spinney_statistics_of() takes it, by ascending value, and the cells of each. There is room for
// `capacity` of each; `count` is how many there are, of which those that have room are written.
spinney_status spinney_classes(const spinney_dataset *dataset,
                               const spinney_box *cells,
                               double *values,
                               uint64_t *counts,
                               size_t capacity,
                               size_t *count);

// Cells of a box (of the deepest level; all if `cells` is NULL) whose first channel lies in each of `count` equal parts of `low`
// to `high`.
spinney_status spinney_histogram(const spinney_dataset *dataset,
                                 const spinney_box *cells,
                                 double low,
                                 double high,
                                 uint64_t *bins,
                                 size_t count);

// As spinney_read(), but cells that are VOID, or outside, get the sample that `fill` points to, which has the type of samples, in
// every channel.
spinney_status spinney_read_filled(const spinney_dataset *dataset,
                                   uint32_t level,
                                   const spinney_box *cells,
                                   const void *fill,
                                   void *samples,
                                   size_t samples_size,
                                   uint8_t *valid,
                                   size_t valid_size);

// As spinney_points(), but `samples` gets the samples of each cell as they are, `cell_size` bytes of each (`samples_size` is the
// bytes of all); those of cells that are VOID, or outside, are 0.
spinney_status spinney_point_samples(const spinney_dataset *dataset,
                                     uint32_t level,
                                     const uint64_t (*cells)[3],
                                     size_t count,
                                     void *samples,
                                     size_t samples_size,
                                     uint8_t *valid);

// The least and the greatest sample of each channel of the cells of a box of the deepest level, of all of them if `cells` is NULL, to
// `least` and `greatest`, which have `cell_size` bytes each (`size`); 0 in channels without any.
spinney_status spinney_extremes(const spinney_dataset *dataset,
                                const spinney_box *cells,
                                void *least,
                                void *greatest,
                                size_t size);

// As spinney_classes(), but `values` gets samples of the dataset's type: there is room for `capacity` of them.
spinney_status spinney_class_samples(const spinney_dataset *dataset,
                                     const spinney_box *cells,
                                     void *values,
                                     uint64_t *counts,
                                     size_t capacity,
                                     size_t *count);

// The number that VOID had in the input, as a sample of the dataset's type with `size` bytes. SPINNEY_UNSUPPORTED if there is none, or
// none of the samples is that number: `nodata` of spinney_info has the nearest double.
spinney_status spinney_nodata(const spinney_dataset *dataset,
                              void *sample,
                              size_t size);

// Reads a box of cells of a level block by block, in rows of blocks, and hands each to `take`, with `user`. Blocks are at most 256
// cells wide and high (64 in octrees), and begin at multiples of that but for the box's own border. Needs memory for one of them.
// SPINNEY_STOPPED if `take` asks to stop.
spinney_status spinney_read_blocks(const spinney_dataset *dataset,
                                   uint32_t level,
                                   const spinney_box *cells,
                                   double fill,
                                   spinney_take_block take,
                                   void *user);

// Opens the file of an exact model, as `spinney build --brep` makes them. `flags` is 0 or SPINNEY_POSITIONED. The model is to
// be closed by spinney_model_close(). Trees of cells are SPINNEY_CORRUPT: spinney_open() is for these.
spinney_status spinney_model_open(const char *path,
                                  uint32_t flags,
                                  spinney_model **model);

// Closes a model; NULL is nothing to close.
void spinney_model_close(spinney_model *model);

// Fails with SPINNEY_CHANGED if the file was overwritten or cut short since it was opened.
spinney_status spinney_model_check_unchanged(const spinney_model *model);

// Tells a model's numbers. `info_size` is `sizeof(spinney_model_info)`.
spinney_status spinney_model_describe(const spinney_model *model,
                                      spinney_model_info *info,
                                      size_t info_size);

// Least and greatest coordinates of the surface, exact: `bounds` has room for three and three.
spinney_status spinney_model_bounds(const spinney_model *model, double (*bounds)[6]);

// Measures the body. `mass_size` is `sizeof(spinney_mass)`. Reads all faces.
spinney_status spinney_model_measure(const spinney_model *model,
                                     spinney_mass *mass,
                                     size_t mass_size);

// Tells of each of `count` points (x, y, z in the world) where it lies: SPINNEY_OUTSIDE, SPINNEY_BOUNDARY or SPINNEY_INSIDE in each of as many bytes. Exact. Works in the
// calling thread; several may ask at once.
spinney_status spinney_model_locate(const spinney_model *model,
                                    const double *points,
                                    size_t count,
                                    int8_t *locations,
                                    size_t location_count);

// Tells how far each of `count` points is from the surface: negative inside, 0 on it, infinite for what is no number. Works in the
// calling thread, as spinney_model_locate() does.
spinney_status spinney_model_distance(const spinney_model *model,
                                      const double *points,
                                      size_t count,
                                      double *distances,
                                      size_t distance_count);

// Finds what a ray from `origin` along `direction` meets first; no ray slips through between two faces. `hit_size` is
// `sizeof(spinney_hit)`.
spinney_status spinney_model_ray(const spinney_model *model,
                                 const double *origin,
                                 const double *direction,
                                 spinney_hit *hit,
                                 size_t hit_size);

// Finds what each of `count` rays, from one of `origins` along one of `directions` (x, y, z each), meets first, to as many `hits`, each of
// which has `hit_size` bytes, `sizeof(spinney_hit)`. Works in the calling thread; several may ask at once. Rays that follow each other take the
// least time where they are near each other.
spinney_status spinney_model_rays(const spinney_model *model,
                                  const double *origins,
                                  const double *directions,
                                  size_t count,
                                  spinney_hit *hits,
                                  size_t hit_count,
                                  size_t hit_size);

// Builds the file of an exact model of `count` meshes, one or more, as `spinney build --brep` does of files: each is an object, whose part
// or parts have names. `mesh_size` is `sizeof(spinney_mesh)`. `options` may be NULL for what is usual, and `report` where nobody asks; else
// `options_size` is `sizeof(spinney_mesh_options)`, and `report_size` `sizeof(spinney_mesh_report)`.
//
// A surface that is open, passes through itself or is inside out bounds no body: SPINNEY_INVALID, with the places, up to 100 of them, in
// spinney_error(). Where it fails there is no file. spinney_warnings() tells where a repair has changed the surface or its volume by more than a
// hundredth, and the like.
spinney_status spinney_model_build(const spinney_mesh *meshes,
                                   size_t count,
                                   size_t mesh_size,
                                   const spinney_mesh_options *options,
                                   size_t options_size,
                                   const char *path,
                                   spinney_mesh_report *report,
                                   size_t report_size);

// Tells of each shell, in the order of their first faces; there is room for `capacity` of them, each of `shell_size` bytes,
// `sizeof(spinney_shell)`. `count` gets how many there are. Takes at most `memory` bytes, about 60 for each corner of a face; reads all faces twice.
spinney_status spinney_model_shells(const spinney_model *model,
                                    uint64_t memory,
                                    spinney_shell *shells,
                                    size_t capacity,
                                    size_t shell_size,
                                    size_t *count);

// Makes the file of the body of a set operation on `count` models, exactly, as `spinney combine` does; `operation` is its number, from 0 to 15: 1
// is the intersection, 2 the first without the second, 6 the symmetric difference, 7 the union, 12 the complement. Grids must have the
// same step. Takes at most `memory` bytes for the faces that are near each other's. Where it fails there is no file; spinney_warnings() tells what of
// the models is not kept.
spinney_status spinney_model_combine(uint32_t operation,
                                     const spinney_model *const *models,
                                     size_t count,
                                     const char *path,
                                     uint64_t memory);

// Cuts the body by the plane through `point` on which `normal` is upright (x, y, z each): polygons with holes. `rings` gets their rings, each of
// `ring_size` bytes, `sizeof(spinney_ring)`, and `points` the points of one ring after the other, in space (x, y, z each). There is
// room for `ring_capacity` rings and `point_capacity` points; `ring_count` and `point_count` get how many there are, and NULL and 0 ask for
// these alone.
//
// The section is that just below the plane: what ends there from below counts, what stands on it does not. Reads only what is cut.
// SPINNEY_UNSUPPORTED for bodies without bounds.
spinney_status spinney_model_section(const spinney_model *model,
                                     const double *point,
                                     const double *normal,
                                     spinney_ring *rings,
                                     size_t ring_capacity,
                                     size_t ring_size,
                                     size_t *ring_count,
                                     double *points,
                                     size_t point_capacity,
                                     size_t *point_count);

// Opens a tree file that the caller reads, of `length` bytes; `name` is for messages, and says which commit is read if it ends with one
// (`map.autumn@12`). What an answer needs is asked for in few calls of `fetch`, and held. `release` (which may be NULL) is called once
// when the dataset and all others of the file are closed, also if opening fails. The dataset is to be closed by spinney_close().
spinney_status spinney_open_parts(const char *name,
                                  uint64_t length,
                                  spinney_fetch fetch,
                                  spinney_release release,
                                  void *user,
                                  spinney_dataset **dataset);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus
