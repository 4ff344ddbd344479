#include "scenes/recording/hdf5_file.h"

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"

#ifdef PALPATE_HDF5

#include <hdf5.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>

namespace palpate {

namespace {

/// A handle that is closed by its own function; throws where HDF5 gave none.
class Handle {
  public:
    Handle(hid_t id, herr_t (*close)(hid_t), const std::filesystem::path& path) : id_(id), close_(close) {
        if (id_ < 0) throw std::runtime_error(path.string() + ": HDF5 cannot write it (is the disk full?)");
    }
    ~Handle() { close_(id_); }
    Handle(const Handle&) = delete;
    Handle& operator=(const Handle&) = delete;
    operator hid_t() const { return id_; }

  private:
    hid_t id_;
    herr_t (*close_)(hid_t);
};

}  // namespace

bool has_hdf5() { return true; }

namespace {

void write_attribute(const std::filesystem::path& path, hid_t object, const char* name, const std::string& value) {
    const Handle text(H5Tcopy(H5T_C_S1), H5Tclose, path);
    H5Tset_size(text, value.size() + 1);
    H5Tset_cset(text, H5T_CSET_UTF8);
    const Handle one(H5Screate(H5S_SCALAR), H5Sclose, path);
    const Handle attribute(H5Acreate2(object, name, text, one, H5P_DEFAULT, H5P_DEFAULT), H5Aclose, path);
    H5Awrite(attribute, text, value.c_str());
}

void write_tables(const std::filesystem::path& path, const std::map<std::string, Series>& tables,
                  const std::map<std::string, std::string>& notes) {
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // what goes wrong is said below
    const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose, path);
    H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_LATEST);  // attributes of any size, for scenes
    const Handle file(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access), H5Fclose, path);
    const Handle groups(H5Pcreate(H5P_LINK_CREATE), H5Pclose, path);
    H5Pset_create_intermediate_group(groups, 1);
    for (const auto& [name, series] : tables) {
        const std::array<hsize_t, 2> size{series.rows(), series.columns.size()};
        const std::array<hsize_t, 2> piece{std::clamp<hsize_t>(size[0], 1, 1024), size[1]};
        const Handle space(H5Screate_simple(2, size.data(), nullptr), H5Sclose, path);
        const Handle layout(H5Pcreate(H5P_DATASET_CREATE), H5Pclose, path);
        H5Pset_chunk(layout, 2, piece.data());
        H5Pset_deflate(layout, 4);
        const Handle data(H5Dcreate2(file, name.c_str(), H5T_IEEE_F64LE, space, groups, layout, H5P_DEFAULT), H5Dclose,
                          path);
        if (size[0] > 0 && H5Dwrite(data, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, series.values.data()) < 0)
            throw std::runtime_error(path.string() + ": HDF5 cannot write " + name + " (is the disk full?)");
        std::string columns, units;
        for (const std::string& c : series.columns) {
            columns += (columns.empty() ? "" : ",") + c;
            units += (units.empty() ? "" : ",") + unit_of(c);
        }
        write_attribute(path, data, "columns", columns);
        write_attribute(path, data, "units", units);
    }
    for (const auto& [name, text] : notes) {
        const std::size_t slash = name.rfind('/');
        const std::string group = slash == std::string::npos ? "/" : name.substr(0, slash);
        const Handle object(H5Oopen(file, group.c_str(), H5P_DEFAULT), H5Oclose, path);
        write_attribute(path, object, name.c_str() + (slash == std::string::npos ? 0 : slash + 1), text);
    }
    if (H5Fflush(file, H5F_SCOPE_GLOBAL) < 0)
        throw std::runtime_error(path.string() + ": HDF5 cannot write it (is the disk full?)");
}

}  // namespace

void write_hdf5(const std::filesystem::path& path, const std::map<std::string, Series>& tables,
                const std::map<std::string, std::string>& notes) {
    std::error_code none;
    if (const auto there = std::filesystem::symlink_status(path, none);
        std::filesystem::exists(there) && !std::filesystem::is_regular_file(there))
        throw std::runtime_error(path.string() + ": is no plain file; tables in HDF5 are written to no other");
    const std::filesystem::path part = path.string() + ".part";
    write_file(part, "");  // says why, where there can be no file
    try {
        write_tables(part, tables, notes);
    } catch (...) {
        std::filesystem::remove(part);
        throw;
    }
    if (std::rename(part.c_str(), path.c_str()) != 0) {
        const int error = errno;
        std::filesystem::remove(part);
        throw_unwritable(path, error);
    }
}

}  // namespace palpate

#else

namespace palpate {

bool has_hdf5() { return false; }

void write_hdf5(const std::filesystem::path& path, const std::map<std::string, Series>&,
                const std::map<std::string, std::string>&) {
    throw InputError(path.string() + ": this palpate was built without HDF5; install libhdf5-dev, and build it again");
}

}  // namespace palpate

#endif
