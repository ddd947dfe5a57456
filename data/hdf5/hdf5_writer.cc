#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "data/files/atomic_file.h"
#include "data/hdf5/hdf5_file.h"
#include "data/hdf5/hdf5_handle.h"

namespace b4mrl {
namespace {

// The enumeration that h5py reads as numpy's bool.
Hdf5Handle BoolType() {
  Hdf5Handle type(H5Tenum_create(H5T_STD_I8LE), H5Tclose);
  const int8_t no = 0;
  const int8_t yes = 1;
  H5Tenum_insert(type.get(), "FALSE", &no);
  H5Tenum_insert(type.get(), "TRUE", &yes);
  return type;
}

Hdf5Handle FileType(Hdf5Type type) {
  switch (type) {
    case Hdf5Type::kFloat32:
      return Hdf5Handle(H5Tcopy(H5T_IEEE_F32LE), H5Tclose);
    case Hdf5Type::kFloat64:
      return Hdf5Handle(H5Tcopy(H5T_IEEE_F64LE), H5Tclose);
    case Hdf5Type::kInteger:
      return Hdf5Handle(H5Tcopy(H5T_STD_U8LE), H5Tclose);
    case Hdf5Type::kBool:
      return BoolType();
    case Hdf5Type::kString:
      break;
  }
  return Hdf5Handle();
}

// Creation properties of datasets without timestamps, so that equal content gives equal bytes.
Hdf5Handle CreationList() {
  Hdf5Handle list(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  H5Pset_obj_track_times(list.get(), false);
  return list;
}

}  // namespace

struct Hdf5Writer::State {
  struct Column {
    Hdf5Handle dataset;
    Hdf5Handle type;
    Hdf5ColumnOptions options;
    std::string path;
    size_t row_bytes = 0;
    uint64_t rows_in_file = 0;
    std::vector<std::byte> buffer;  // fewer than chunk_rows rows
  };

  explicit State(AtomicFile atomic) : file(std::move(atomic)) {}
  ~State() { CloseFile(); }

  // Datasets are closed before the file. Errors such as a full disk are remembered in `driver`.
  void CloseFile() {
    columns.clear();
    handle.Reset();
  }
  Status Failure(std::string_view action, std::string_view path) const {
    if (driver.error_number != 0) return IoError("write", file.path(), driver.error_number);
    return Status(StatusCode::kInternal,
                  fmt::format("HDF5 cannot {} '{}' in {}", action, path, file.path()));
  }
  Status EnsureGroups(std::string_view path);
  Status FlushColumn(Column& column);
  Status WriteWhole(std::string_view path, hid_t file_type, hid_t memory_type,
                    const Hdf5Handle& space, const Hdf5Handle& creation, const void* data);
  Status WriteScalar(std::string_view path, hid_t file_type, hid_t memory_type, const void* data);

  AtomicFile file;
  Hdf5DriverState driver;
  Hdf5Handle handle;
  std::vector<Column> columns;
};

Status Hdf5Writer::State::EnsureGroups(std::string_view path) {
  for (size_t slash = path.find('/'); slash != std::string_view::npos;
       slash = path.find('/', slash + 1)) {
    const std::string group(path.substr(0, slash));
    if (H5Lexists(handle.get(), group.c_str(), H5P_DEFAULT) > 0) continue;
    Hdf5Handle creation(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
    H5Pset_obj_track_times(creation.get(), false);
    const Hdf5Handle made(
        H5Gcreate2(handle.get(), group.c_str(), H5P_DEFAULT, creation.get(), H5P_DEFAULT),
        H5Gclose);
    if (!made.valid()) return Failure("create group", group);
  }
  return Status();
}

Status Hdf5Writer::State::FlushColumn(Column& column) {
  const uint64_t rows = column.buffer.size() / column.row_bytes;
  if (rows == 0) return Status();
  const int rank = column.options.width == 0 ? 1 : 2;
  const std::array<hsize_t, 2> extent = {column.rows_in_file + rows, column.options.width};
  const std::array<hsize_t, 2> start = {column.rows_in_file, 0};
  const std::array<hsize_t, 2> count = {rows, column.options.width};
  if (H5Dset_extent(column.dataset.get(), extent.data()) < 0) return Failure("extend", column.path);
  const Hdf5Handle file_space(H5Dget_space(column.dataset.get()), H5Sclose);
  const Hdf5Handle memory_space(H5Screate_simple(rank, count.data(), nullptr), H5Sclose);
  H5Sselect_hyperslab(file_space.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(),
                      nullptr);
  const herr_t written = H5Dwrite(column.dataset.get(), column.type.get(), memory_space.get(),
                                  file_space.get(), H5P_DEFAULT, column.buffer.data());
  if (written < 0 || driver.error_number != 0) return Failure("write", column.path);
  column.rows_in_file += rows;
  column.buffer.clear();
  return Status();
}

// Creates a dataset of fixed shape and writes all of it.
Status Hdf5Writer::State::WriteWhole(std::string_view path, hid_t file_type, hid_t memory_type,
                                     const Hdf5Handle& space, const Hdf5Handle& creation,
                                     const void* data) {
  B4MRL_RETURN_IF_ERROR(EnsureGroups(path));
  const std::string name(path);
  const Hdf5Handle dataset(H5Dcreate2(handle.get(), name.c_str(), file_type, space.get(),
                                      H5P_DEFAULT, creation.get(), H5P_DEFAULT),
                           H5Dclose);
  if (!dataset.valid() ||
      H5Dwrite(dataset.get(), memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) < 0) {
    return Failure("write", path);
  }
  return Status();
}

Status Hdf5Writer::State::WriteScalar(std::string_view path, hid_t file_type, hid_t memory_type,
                                      const void* data) {
  const Hdf5Handle space(H5Screate(H5S_SCALAR), H5Sclose);
  return WriteWhole(path, file_type, memory_type, space, CreationList(), data);
}

Hdf5Writer::Hdf5Writer(std::unique_ptr<State> state) : state_(std::move(state)) {}
Hdf5Writer::Hdf5Writer(Hdf5Writer&&) noexcept = default;
Hdf5Writer& Hdf5Writer::operator=(Hdf5Writer&&) noexcept = default;
Hdf5Writer::~Hdf5Writer() = default;

Result<Hdf5Writer> Hdf5Writer::Create(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(path));
  auto state = std::make_unique<State>(std::move(file));
  state->driver = {.fd = state->file.fd(), .writable = true};
  const Hdf5Handle access = Hdf5DriverAccess(&state->driver);
  state->handle =
      Hdf5Handle(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access.get()), H5Fclose);
  if (!state->handle.valid()) return state->Failure("create", path);
  return Hdf5Writer(std::move(state));
}

Result<Hdf5Writer::ColumnId> Hdf5Writer::CreateColumn(std::string_view path,
                                                      const Hdf5ColumnOptions& options) {
  if (options.type == Hdf5Type::kString || options.chunk_rows == 0 ||
      options.compression_level < 0 || options.compression_level > 9) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("column '{}' needs a numeric type, chunk_rows above 0 and a "
                              "compression level in 0..9",
                              path));
  }
  B4MRL_RETURN_IF_ERROR(state_->EnsureGroups(path));
  State::Column column;
  column.options = options;
  column.path = path;
  column.type = FileType(options.type);
  column.row_bytes = H5Tget_size(column.type.get()) * std::max<uint64_t>(options.width, 1);
  const int rank = options.width == 0 ? 1 : 2;
  const std::array<hsize_t, 2> none = {0, options.width};
  const std::array<hsize_t, 2> endless = {H5S_UNLIMITED, options.width};
  const std::array<hsize_t, 2> chunk = {options.chunk_rows, options.width};
  const Hdf5Handle space(H5Screate_simple(rank, none.data(), endless.data()), H5Sclose);
  const Hdf5Handle creation = CreationList();
  H5Pset_chunk(creation.get(), rank, chunk.data());
  if (options.compression_level > 0) {
    H5Pset_shuffle(creation.get());
    H5Pset_deflate(creation.get(), static_cast<unsigned>(options.compression_level));
  }
  H5Pset_fletcher32(creation.get());
  column.dataset =
      Hdf5Handle(H5Dcreate2(state_->handle.get(), column.path.c_str(), column.type.get(),
                            space.get(), H5P_DEFAULT, creation.get(), H5P_DEFAULT),
                 H5Dclose);
  if (!column.dataset.valid()) return state_->Failure("create", path);
  column.buffer.reserve(options.chunk_rows * column.row_bytes);
  state_->columns.push_back(std::move(column));
  return state_->columns.size() - 1;
}

Status Hdf5Writer::AppendBytes(ColumnId id, Hdf5Type given, std::span<const std::byte> bytes) {
  if (id >= state_->columns.size()) {
    return InvalidNumber("column", static_cast<double>(id), "one that CreateColumn returned");
  }
  State::Column& column = state_->columns[id];
  const Hdf5Type type = column.options.type;
  const bool types_fit = given == type || (given == Hdf5Type::kInteger && type == Hdf5Type::kBool);
  if (!types_fit || bytes.size() % column.row_bytes != 0) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("'{}' takes whole rows of {} x {}, not {} bytes of {}", column.path,
                              std::max<uint64_t>(column.options.width, 1), Hdf5TypeName(type),
                              bytes.size(), Hdf5TypeName(given)));
  }
  const size_t chunk_bytes = column.options.chunk_rows * column.row_bytes;
  while (!bytes.empty()) {
    const size_t take = std::min(bytes.size(), chunk_bytes - column.buffer.size());
    column.buffer.insert(column.buffer.end(), bytes.begin(), bytes.begin() + take);
    bytes = bytes.subspan(take);
    if (column.buffer.size() == chunk_bytes) B4MRL_RETURN_IF_ERROR(state_->FlushColumn(column));
  }
  return Status();
}

Status Hdf5Writer::Append(ColumnId column, std::span<const float> values) {
  return AppendBytes(column, Hdf5Type::kFloat32, std::as_bytes(values));
}

Status Hdf5Writer::Append(ColumnId column, std::span<const double> values) {
  return AppendBytes(column, Hdf5Type::kFloat64, std::as_bytes(values));
}

Status Hdf5Writer::Append(ColumnId column, std::span<const uint8_t> values) {
  return AppendBytes(column, Hdf5Type::kInteger, std::as_bytes(values));
}

Status Hdf5Writer::WriteArray(std::string_view path, std::span<const float> values,
                              std::span<const uint64_t> shape) {
  uint64_t elements = shape.empty() || shape.size() > 2 ? 0 : 1;
  for (const uint64_t extent : shape) elements *= extent;
  if (elements == 0 || elements != values.size()) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("'{}' has {} values for {} elements in {} dimensions (1 or 2)", path,
                              values.size(), elements, shape.size()));
  }
  const std::vector<hsize_t> extents(shape.begin(), shape.end());
  const int rank = static_cast<int>(extents.size());
  const Hdf5Handle space(H5Screate_simple(rank, extents.data(), nullptr), H5Sclose);
  const Hdf5Handle creation = CreationList();
  // One chunk, because only chunked storage carries checksums.
  H5Pset_chunk(creation.get(), rank, extents.data());
  H5Pset_fletcher32(creation.get());
  return state_->WriteWhole(path, H5T_IEEE_F32LE, H5T_NATIVE_FLOAT, space, creation, values.data());
}

Status Hdf5Writer::CreateArray(std::string_view path, Hdf5Type type,
                               std::span<const uint64_t> shape) {
  const bool fits = !shape.empty() && shape.size() <= 2 && !std::ranges::count(shape, 0u);
  if (!fits || type == Hdf5Type::kString) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("array '{}' needs a numeric type and 1 or 2 extents above 0", path));
  }
  B4MRL_RETURN_IF_ERROR(state_->EnsureGroups(path));
  const std::vector<hsize_t> extents(shape.begin(), shape.end());
  const Hdf5Handle space(
      H5Screate_simple(static_cast<int>(extents.size()), extents.data(), nullptr), H5Sclose);
  const Hdf5Handle dataset(
      H5Dcreate2(state_->handle.get(), std::string(path).c_str(), FileType(type).get(), space.get(),
                 H5P_DEFAULT, CreationList().get(), H5P_DEFAULT),
      H5Dclose);
  return dataset.valid() ? Status() : state_->Failure("create", path);
}

Status Hdf5Writer::WriteBytes(std::string_view path, uint64_t first_row,
                              std::span<const std::byte> bytes) {
  const Hdf5Handle dataset(H5Dopen2(state_->handle.get(), std::string(path).c_str(), H5P_DEFAULT),
                           H5Dclose);
  const Hdf5Handle type(H5Dget_type(dataset.get()), H5Tclose);
  const Hdf5Handle file_space(H5Dget_space(dataset.get()), H5Sclose);
  std::array<hsize_t, 2> extent = {0, 1};
  const int rank = H5Sget_simple_extent_dims(file_space.get(), extent.data(), nullptr);
  if (rank < 1) return state_->Failure("open", path);
  const size_t row_bytes = H5Tget_size(type.get()) * extent[1];
  const std::array<hsize_t, 2> start = {first_row, 0};
  const std::array<hsize_t, 2> count = {bytes.size() / row_bytes, extent[1]};
  if (bytes.size() % row_bytes != 0 || first_row > extent[0] || count[0] > extent[0] - first_row) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("{} bytes from row {} on are not whole rows of '{}'", bytes.size(),
                              first_row, path));
  }
  const Hdf5Handle memory_space(H5Screate_simple(rank, count.data(), nullptr), H5Sclose);
  H5Sselect_hyperslab(file_space.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(),
                      nullptr);
  const herr_t written = H5Dwrite(dataset.get(), type.get(), memory_space.get(), file_space.get(),
                                  H5P_DEFAULT, bytes.data());
  if (written < 0 || state_->driver.error_number != 0) return state_->Failure("write", path);
  return Status();
}

Status Hdf5Writer::WriteRows(std::string_view array, uint64_t first_row,
                             std::span<const float> values) {
  return WriteBytes(array, first_row, std::as_bytes(values));
}

Status Hdf5Writer::WriteRows(std::string_view array, uint64_t first_row,
                             std::span<const uint8_t> values) {
  return WriteBytes(array, first_row, std::as_bytes(values));
}

Status Hdf5Writer::CreateGroup(std::string_view path) {
  return state_->EnsureGroups(fmt::format("{}/", path));
}

Status Hdf5Writer::WriteAttribute(std::string_view group, std::string_view name, int64_t value) {
  const Hdf5Handle space(H5Screate(H5S_SCALAR), H5Sclose);
  const Hdf5Handle attribute(
      H5Acreate_by_name(state_->handle.get(), std::string(group).c_str(), std::string(name).c_str(),
                        H5T_STD_I64LE, space.get(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
      H5Aclose);
  if (!attribute.valid() || H5Awrite(attribute.get(), H5T_NATIVE_INT64, &value) < 0) {
    return state_->Failure("write attribute of", group);
  }
  return Status();
}

Status Hdf5Writer::WriteString(std::string_view path, std::string_view text) {
  // HDF5 has no strings of length 0; one padding byte reads back as "".
  const std::string padded = text.empty() ? std::string(1, '\0') : std::string(text);
  const Hdf5Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type.get(), padded.size());
  H5Tset_strpad(type.get(), H5T_STR_NULLPAD);
  return state_->WriteScalar(path, type.get(), type.get(), padded.data());
}

Status Hdf5Writer::WriteInteger(std::string_view path, int64_t value) {
  return state_->WriteScalar(path, H5T_STD_I64LE, H5T_NATIVE_INT64, &value);
}

Status Hdf5Writer::WriteNumber(std::string_view path, double value) {
  return state_->WriteScalar(path, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &value);
}

Status Hdf5Writer::Commit(Existing existing) {
  for (State::Column& column : state_->columns) B4MRL_RETURN_IF_ERROR(state_->FlushColumn(column));
  const std::string path = state_->file.path();
  const bool flushed = H5Fflush(state_->handle.get(), H5F_SCOPE_GLOBAL) >= 0;
  state_->CloseFile();
  if (!flushed || state_->driver.error_number != 0) return state_->Failure("flush", path);
  return state_->file.Commit(existing);
}

}  // namespace b4mrl
