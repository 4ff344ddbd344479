// Surfaces and tetrahedra from files. The first byte chooses the kind.

#include "meshes/mesh_files.h"
#include "meshes/input_error.h"
#include "meshes/surface.h"
#include "tests/fuzz/temporary_file.h"

using namespace palpate;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    if (size < 1) return 0;
    static const char* const kinds[] = {".obj", ".stl", ".ply", ".off", ".msh", ".vtu", ".node"};
    const std::string kind = kinds[data[0] % 7];
    std::span<const std::uint8_t> bytes(data + 1, size - 1);
    if (kind == ".node") {  // in two files
        temporary_file(".ele", bytes.subspan(bytes.size() / 2));
        bytes = bytes.first(bytes.size() / 2);
    }
    const std::string path = temporary_file(kind, bytes);
    try {
        if (data[0] % 7 < 4)
            read_surface(path, "mm");
        else
            read_tet_mesh(path, "mm");
    } catch (const InputError&) {}
    return 0;
}
