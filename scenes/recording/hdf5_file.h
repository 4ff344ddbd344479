#pragma once
// Tables in an HDF5 file, for runs that are large, where the program was built with it.

#include <map>

#include "scenes/run/series.h"

namespace palpate {

/// Whether this program can write HDF5.
bool has_hdf5();

/// One dataset per series, [row][column] f64, compressed; its columns' names, and their units, joined by commas, as
/// attributes "columns" and "units". Names with slashes become groups. `notes` are attributes of the file, or of the
/// group that stands before a slash ("run_0002/settings"), which has a table. The file is complete or absent. Throws as
/// throw_unwritable, and InputError where has_hdf5() is false.
void write_hdf5(const std::filesystem::path& path, const std::map<std::string, Series>& tables,
                const std::map<std::string, std::string>& notes = {});

}  // namespace palpate
