// OpenVDB with the same meshes: a level set, its interior mask, a file.
//
//   solid mesh MODEL.ply CELLS OUT.vdb      of a binary little-endian PLY file of triangles
//   solid union A.vdb B.vdb OUT.vdb         of two level sets

#include <openvdb/openvdb.h>
#include <openvdb/tools/Composite.h>
#include <openvdb/tools/LevelSetUtil.h>
#include <openvdb/tools/MeshToVolume.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

using openvdb::Vec3I;
using openvdb::Vec3s;

static void fail(const std::string& text) {
    std::cerr << text << "\n";
    std::exit(1);
}

// Reads the PLY files of benches/peers/solids.py: float x, y, z; lists of three ints.
static void read(const char* path, std::vector<Vec3s>& points, std::vector<Vec3I>& triangles) {
    std::ifstream file(path, std::ios::binary);
    std::string line;
    size_t vertices = 0, faces = 0;
    while (std::getline(file, line) && line != "end_header") {
        std::istringstream words(line);
        std::string a, b;
        size_t count = 0;
        words >> a >> b >> count;
        if (a == "element" && b == "vertex") vertices = count;
        if (a == "element" && b == "face") faces = count;
    }
    if (!file || !vertices) fail("not a PLY file of solids.py");
    points.resize(vertices);
    file.read(reinterpret_cast<char*>(points.data()), vertices * 12);
    std::vector<char> bytes(faces * 13);
    file.read(bytes.data(), bytes.size());
    if (!file) fail("the PLY file is too short");
    triangles.resize(faces);
    for (size_t i = 0; i < faces; ++i) std::copy_n(&bytes[13 * i + 1], 12, reinterpret_cast<char*>(&triangles[i]));
}

static openvdb::FloatGrid::Ptr level_set(const char* path) {
    openvdb::io::File file(path);
    file.open();
    auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(file.readGrid("surface"));
    file.close();
    return grid;
}

int main(int count, char** words) {
    openvdb::initialize();
    const std::string what = count > 1 ? words[1] : "";
    openvdb::GridPtrVec grids;
    if (what == "mesh" && count == 5) {
        std::vector<Vec3s> points;
        std::vector<Vec3I> triangles;
        read(words[2], points, triangles);
        Vec3s low = points[0], high = points[0];
        for (const Vec3s& point : points) {
            low = openvdb::math::minComponent(low, point);
            high = openvdb::math::maxComponent(high, point);
        }
        const Vec3s size = high - low;
        const double cell = std::max({size[0], size[1], size[2]}) / std::atof(words[3]);
        auto transform = openvdb::math::Transform::createLinearTransform(cell);
        auto surface = openvdb::tools::meshToLevelSet<openvdb::FloatGrid>(*transform, points, triangles, 3.0f);
        auto inside = openvdb::tools::sdfInteriorMask(*surface);
        surface->setName("surface");
        inside->setName("inside");
        std::cout << "inside " << inside->activeVoxelCount() << " volume " << inside->activeVoxelCount() * cell * cell * cell
                  << "\n";
        grids = {surface, inside};
    } else if (what == "union" && count == 5) {
        auto a = level_set(words[2]), b = level_set(words[3]);
        openvdb::tools::csgUnion(*a, *b);
        a->setName("surface");
        grids = {a};
    } else {
        fail("usage: solid mesh MODEL.ply CELLS OUT.vdb | solid union A.vdb B.vdb OUT.vdb");
    }
    openvdb::io::File(words[count - 1]).write(grids);
    return 0;
}
