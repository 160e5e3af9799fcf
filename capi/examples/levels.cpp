// Reads all levels of a Spinney file block by block, and prints the mean of the first channel of
// each:
//
//     levels map.goblin

#include <cstring>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <vector>

#include "spinney.h"

namespace {

void check(spinney_status status) {
  if (status != SPINNEY_OK) {
    throw std::runtime_error(spinney_error());
  }
}

struct Close {
  void operator()(spinney_dataset *dataset) const { spinney_close(dataset); }
};
using Dataset = std::unique_ptr<spinney_dataset, Close>;

Dataset open(const char *path) {
  spinney_dataset *dataset = nullptr;
  check(spinney_open(path, nullptr, 0, 0, &dataset));
  return Dataset(dataset);
}

template <typename Sample>
double sample_as(const uint8_t *bytes) {
  Sample sample;
  std::memcpy(&sample, bytes, sizeof sample); // samples need not be aligned
  return static_cast<double>(sample);
}

double first_sample(spinney_sample_type type, const uint8_t *cell) {
  switch (type) {
  case SPINNEY_U8:
    return sample_as<uint8_t>(cell);
  case SPINNEY_U16:
    return sample_as<uint16_t>(cell);
  case SPINNEY_I16:
    return sample_as<int16_t>(cell);
  case SPINNEY_U32:
    return sample_as<uint32_t>(cell);
  case SPINNEY_I32:
    return sample_as<int32_t>(cell);
  case SPINNEY_F32:
    return sample_as<float>(cell);
  case SPINNEY_F64:
    return sample_as<double>(cell);
  case SPINNEY_I8:
    return sample_as<int8_t>(cell);
  case SPINNEY_U64:
    return sample_as<uint64_t>(cell);
  case SPINNEY_I64:
    return sample_as<int64_t>(cell);
  }
  throw std::logic_error("unknown sample type");
}

struct Sum {
  spinney_info info{};
  double sum = 0.0;
  uint64_t cells = 0;
};

// A callback of the library must not throw.
int add(void *user, const spinney_block *block) noexcept {
  Sum &sum = *static_cast<Sum *>(user);
  const uint64_t cells = block->cells.size[0] * block->cells.size[1] * block->cells.size[2];
  for (uint64_t cell = 0; cell < cells; ++cell) {
    if (block->valid[cell] != 0) {
      sum.sum += first_sample(sum.info.sample, static_cast<const uint8_t *>(block->samples) + cell * sum.info.cell_size);
      sum.cells += 1;
    }
  }
  return 0;
}

void print_levels(const char *path) {
  const Dataset dataset = open(path);
  Sum sum;
  check(spinney_describe(dataset.get(), &sum.info, sizeof sum.info));
  for (uint32_t level = 0; level <= sum.info.depth; ++level) {
    spinney_box all{};
    check(spinney_level_size(dataset.get(), level, &all.size));
    sum.sum = 0.0;
    sum.cells = 0;
    check(spinney_read_blocks(dataset.get(), level, &all, 0.0, add, &sum));
    std::cout << "level " << level << ": " << all.size[0] << " x " << all.size[1] << " x " << all.size[2] << ", "
              << sum.cells << " with a value, mean " << (sum.cells > 0 ? sum.sum / static_cast<double>(sum.cells) : 0.0)
              << "\n";
  }
  spinney_statistics statistics{};
  check(spinney_statistics_of(dataset.get(), nullptr, &statistics));
  std::cout << "exactly: " << statistics.cells << " cells, mean " << statistics.channels[0].mean << "\n";
}

} // namespace

int main(int count, char **words) {
  if (count != 2) {
    std::cerr << "usage: levels FILE\n";
    return 2;
  }
  try {
    print_levels(words[1]);
  } catch (const std::exception &error) {
    std::cerr << "levels: " << error.what() << "\n";
    return 1;
  }
  return 0;
}
