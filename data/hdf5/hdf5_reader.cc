#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "data/files/stored_bytes.h"
#include "data/hdf5/hdf5_file.h"
#include "data/hdf5/hdf5_handle.h"
#include "data/hdf5/hdf5_heap.h"
#include "proto/base/limits.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {
namespace {

constexpr size_t kMaxStringBytes = 64 * 1024;
// WriteArray stores an array as one chunk, so that the longest array that ReadFloats takes is the
// largest chunk. The importer unpacks chunks of strangers in 2 GiB, which hold several of these.
constexpr uint64_t kMaxChunkBytes = kMaxReadFloats * sizeof(float);
constexpr uint64_t kMaxBlockBytes = 64ull << 20;
constexpr uint64_t kDefaultBlockRows = 65536;
constexpr int kMaxFilters = 4;
// Deflate's best ratio is 1032:1; the slack covers small datasets, which are stored in headers.
constexpr uint64_t kMaxInflation = 1032;
constexpr uint64_t kInflationSlackBytes = 64 * 1024;

Status Refuse(StatusCode code, std::string_view dataset, std::string_view reason) {
  return Status(code, fmt::format("dataset '{}' {}", dataset, reason));
}

Result<Hdf5Type> Classify(hid_t type, std::string_view path) {
  switch (H5Tget_class(type)) {
    case H5T_FLOAT: {
      if (H5Tequal(type, H5T_IEEE_F32LE) > 0 || H5Tequal(type, H5T_IEEE_F32BE) > 0) {
        return Hdf5Type::kFloat32;
      }
      if (H5Tequal(type, H5T_IEEE_F64LE) > 0 || H5Tequal(type, H5T_IEEE_F64BE) > 0) {
        return Hdf5Type::kFloat64;
      }
      break;
    }
    case H5T_INTEGER:
      if (H5Tget_size(type) <= 8) return Hdf5Type::kInteger;
      break;
    case H5T_ENUM:
      if (H5Tget_size(type) == 1) return Hdf5Type::kBool;
      break;
    case H5T_STRING:
      if (H5Tis_variable_str(type) == 0) return Hdf5Type::kString;
      break;
    default:
      break;
  }
  return Refuse(StatusCode::kInvalidArgument, path,
                "has an unsupported type, allowed: float32, float64; for flags and whole numbers "
                "integer, bool; for text fixed-length string");
}

bool IsHardLinked(hid_t file, std::string_view path) {
  size_t end = 0;
  while (end != std::string_view::npos) {
    end = path.find('/', end + 1);
    const std::string prefix(path.substr(0, end));
    H5L_info_t info{};
    if (H5Lget_info(file, prefix.c_str(), &info, H5P_DEFAULT) < 0 || info.type != H5L_TYPE_HARD) {
      return false;
    }
  }
  return true;
}

Status CheckFilters(hid_t creation, std::string_view path) {
  const int filters = H5Pget_nfilters(creation);
  if (filters < 0 || filters > kMaxFilters) {
    return Refuse(StatusCode::kInvalidArgument, path, "has too many filters");
  }
  for (int i = 0; i < filters; ++i) {
    unsigned flags = 0;
    unsigned config = 0;
    size_t values = 0;
    const H5Z_filter_t filter = H5Pget_filter2(creation, static_cast<unsigned>(i), &flags, &values,
                                               nullptr, 0, nullptr, &config);
    if (filter != H5Z_FILTER_DEFLATE && filter != H5Z_FILTER_SHUFFLE &&
        filter != H5Z_FILTER_FLETCHER32) {
      return Refuse(StatusCode::kInvalidArgument, path,
                    fmt::format("uses filter {}, allowed: deflate, shuffle, fletcher32; rewrite "
                                "the file with `h5repack -f GZIP=4`",
                                static_cast<int>(filter)));
    }
  }
  return Status();
}

}  // namespace

std::string_view Hdf5TypeName(Hdf5Type type) {
  constexpr std::array<std::string_view, 5> kNames = {"float32", "float64", "integer", "bool",
                                                      "string"};
  return kNames[static_cast<size_t>(type)];
}

struct Hdf5OpenFile {
  UniqueFd fd;
  Hdf5DriverState driver;
  uint64_t stored_bytes = 0;  // size of the file without its holes
  Hdf5Handle handle;
  std::string path;

  Result<Hdf5Handle> OpenDataset(std::string_view dataset) const;
};

// Opens a dataset whose path goes over hard links alone.
Result<Hdf5Handle> Hdf5OpenFile::OpenDataset(std::string_view dataset) const {
  if (!IsHardLinked(handle.get(), dataset)) {
    return Status(StatusCode::kUnknownName, fmt::format("{} has no dataset '{}'", path, dataset));
  }
  Hdf5Handle opened(H5Dopen2(handle.get(), std::string(dataset).c_str(), H5P_DEFAULT), H5Dclose);
  if (opened.valid()) return opened;
  return Refuse(StatusCode::kInvalidArgument, dataset, "cannot be opened as a dataset");
}

struct Hdf5Column::State {
  std::shared_ptr<const Hdf5OpenFile> file;  // keeps the descriptor while the dataset is open
  Hdf5Handle dataset;
  std::string path;
  Hdf5Type type = Hdf5Type::kFloat32;
  std::vector<uint64_t> shape;
  uint64_t element_bytes = 0;
  uint64_t block_rows = 1;

  uint64_t rows() const { return shape.empty() ? 1 : shape[0]; }
  uint64_t width() const { return shape.size() < 2 ? 1 : shape[1]; }
  Status Describe();
  Status CheckLayout();
  Status CheckInflation() const;
  Status Read(uint64_t first_row, uint64_t elements, hid_t memory_type, void* out) const;
};

// Reads type and extents and checks them against the limits.
Status Hdf5Column::State::Describe() {
  const Hdf5Handle stored_type(H5Dget_type(dataset.get()), H5Tclose);
  const Hdf5Handle space(H5Dget_space(dataset.get()), H5Sclose);
  if (!stored_type.valid() || !space.valid()) {
    return Refuse(StatusCode::kDataLoss, path, "has a damaged header");
  }
  B4MRL_ASSIGN_OR_RETURN(type, Classify(stored_type.get(), path));
  element_bytes = H5Tget_size(stored_type.get());
  const int rank = H5Sget_simple_extent_ndims(space.get());
  const bool is_simple = H5Sget_simple_extent_type(space.get()) != H5S_NULL;
  if (rank < 0 || rank > 2 || !is_simple) {
    return Refuse(StatusCode::kInvalidArgument, path,
                  fmt::format("has {} dimensions, allowed: 0..2", rank));
  }
  std::array<hsize_t, 2> extents{};
  H5Sget_simple_extent_dims(space.get(), extents.data(), nullptr);
  shape.assign(extents.begin(), extents.begin() + rank);
  if (rows() > limits::kMaxDatasetRows || width() > limits::kMaxObservationDimensions ||
      element_bytes > kMaxStringBytes) {
    return Refuse(StatusCode::kLimitExceeded, path,
                  fmt::format("declares {} rows of {} elements of {} bytes, allowed: {} rows of {}",
                              rows(), width(), element_bytes, limits::kMaxDatasetRows,
                              limits::kMaxObservationDimensions));
  }
  return Status();
}

Status Hdf5Column::State::CheckLayout() {
  const Hdf5Handle creation(H5Dget_create_plist(dataset.get()), H5Pclose);
  if (!creation.valid()) return Refuse(StatusCode::kDataLoss, path, "has a damaged header");
  const H5D_layout_t layout = H5Pget_layout(creation.get());
  if (layout != H5D_COMPACT && layout != H5D_CONTIGUOUS && layout != H5D_CHUNKED) {
    return Refuse(StatusCode::kInvalidArgument, path,
                  "has a virtual or unknown layout, allowed: compact, contiguous, chunked");
  }
  if (H5Pget_external_count(creation.get()) != 0) {
    return Refuse(StatusCode::kInvalidArgument, path, "keeps its data in another file");
  }
  B4MRL_RETURN_IF_ERROR(CheckFilters(creation.get(), path));
  const uint64_t row_bytes = std::max<uint64_t>(width() * element_bytes, 1);
  block_rows = std::clamp<uint64_t>(kMaxBlockBytes / row_bytes, 1, kDefaultBlockRows);
  if (layout != H5D_CHUNKED) return Status();
  std::array<hsize_t, 2> chunk = {1, 1};
  const int rank = H5Pget_chunk(creation.get(), 2, chunk.data());
  const bool fits = rank == static_cast<int>(shape.size()) && chunk[0] >= 1 && chunk[1] >= 1 &&
                    chunk[0] <= kMaxChunkBytes && chunk[1] <= kMaxChunkBytes &&
                    chunk[0] * chunk[1] <= kMaxChunkBytes / element_bytes;
  if (!fits) {
    return Refuse(StatusCode::kLimitExceeded, path,
                  fmt::format("declares chunks of {} x {} elements, allowed: {} bytes a chunk",
                              chunk[0], chunk[1], kMaxChunkBytes));
  }
  // A whole number of chunks, near the default, so that no chunk is inflated twice.
  block_rows = std::max<uint64_t>(block_rows / chunk[0], 1) * chunk[0];
  return Status();
}

// Refuses extents that the stored bytes cannot inflate to, before memory is allocated for them.
Status Hdf5Column::State::CheckInflation() const {
  const uint64_t declared = rows() * width() * element_bytes;
  const uint64_t stored =
      std::min<uint64_t>(H5Dget_storage_size(dataset.get()), file->stored_bytes);
  if (declared <= kInflationSlackBytes + stored * kMaxInflation) return Status();
  return Refuse(StatusCode::kDataLoss, path,
                fmt::format("declares {} bytes but stores {}: it is crafted, or has rows that were "
                            "never written",
                            declared, stored));
}

Status Hdf5Column::State::Read(uint64_t first_row, uint64_t elements, hid_t memory_type,
                               void* out) const {
  if (type == Hdf5Type::kString) return Refuse(StatusCode::kInvalidArgument, path, "is a string");
  if (elements == 0) return Status();
  const uint64_t count_rows = elements / width();
  if (elements % width() != 0 || first_row > rows() || count_rows > rows() - first_row) {
    return Refuse(StatusCode::kInvalidArgument, path,
                  fmt::format("has {} rows of {}; {} elements from row {} are not in it", rows(),
                              width(), elements, first_row));
  }
  const Hdf5Handle file_space(H5Dget_space(dataset.get()), H5Sclose);
  const std::array<hsize_t, 2> start = {first_row, 0};
  const std::array<hsize_t, 2> count = {count_rows, width()};
  if (!shape.empty()) {
    H5Sselect_hyperslab(file_space.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(),
                        nullptr);
  }
  const hsize_t flat = elements;
  const Hdf5Handle memory_space(H5Screate_simple(1, &flat, nullptr), H5Sclose);
  if (H5Dread(dataset.get(), memory_type, memory_space.get(), file_space.get(), H5P_DEFAULT, out) <
      0) {
    return Refuse(StatusCode::kDataLoss, path,
                  fmt::format("cannot be read at rows {}..{} (truncated, or its checksum differs)",
                              first_row, first_row + count_rows));
  }
  return Status();
}

const std::string& Hdf5Column::path() const { return state_->path; }
Hdf5Type Hdf5Column::type() const { return state_->type; }
const std::vector<uint64_t>& Hdf5Column::shape() const { return state_->shape; }
uint64_t Hdf5Column::rows() const { return state_->rows(); }
uint64_t Hdf5Column::width() const { return state_->width(); }
uint64_t Hdf5Column::block_rows() const { return state_->block_rows; }

Status Hdf5Column::Read(uint64_t first_row, std::span<float> out) const {
  return state_->Read(first_row, out.size(), H5T_NATIVE_FLOAT, out.data());
}

Status Hdf5Column::Read(uint64_t first_row, std::span<double> out) const {
  return state_->Read(first_row, out.size(), H5T_NATIVE_DOUBLE, out.data());
}

Status Hdf5Column::ReadFlags(uint64_t first_row, std::span<uint8_t> out) const {
  if (type() != Hdf5Type::kInteger && type() != Hdf5Type::kBool) {
    return Refuse(StatusCode::kInvalidArgument, path(),
                  fmt::format("is {}, allowed: bool or integer", Hdf5TypeName(type())));
  }
  // The library does not convert enumerations to integers, so enumerations are read as their base
  // type.
  const Hdf5Handle stored(H5Dget_type(state_->dataset.get()), H5Tclose);
  if (type() == Hdf5Type::kBool) {
    B4MRL_RETURN_IF_ERROR(state_->Read(first_row, out.size(), stored.get(), out.data()));
  } else {
    std::vector<int64_t> wide(out.size());
    B4MRL_RETURN_IF_ERROR(state_->Read(first_row, out.size(), H5T_NATIVE_INT64, wide.data()));
    std::transform(wide.begin(), wide.end(), out.begin(), [](int64_t v) { return v != 0; });
  }
  for (uint8_t& flag : out) flag = flag != 0;
  return Status();
}

Result<Hdf5Reader> Hdf5Reader::Open(const std::string& path) {
  auto file = std::make_shared<Hdf5OpenFile>();
  file->path = path;
  file->fd = UniqueFd(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!file->fd.valid()) return IoError("open", path, errno);
  struct stat info {};
  if (fstat(file->fd.get(), &info) != 0) return IoError("inspect", path, errno);
  if (!S_ISREG(info.st_mode)) {
    return InvalidArgument("path", path, "a regular file");
  }
  file->stored_bytes = StoredBytes(file->fd.get());
  file->driver = {.fd = file->fd.get(), .file_bytes = static_cast<uint64_t>(info.st_size)};
  const Hdf5Handle access = Hdf5DriverAccess(&file->driver);
  file->handle = Hdf5Handle(H5Fopen(path.c_str(), H5F_ACC_RDONLY, access.get()), H5Fclose);
  if (!file->handle.valid()) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("{} is not an HDF5 file, or it is truncated or damaged", path));
  }
  return Hdf5Reader(std::move(file));
}

bool Hdf5Reader::Exists(std::string_view path) const {
  return IsHardLinked(file_->handle.get(), path);
}

Result<Hdf5Column> Hdf5Reader::OpenColumn(std::string_view path) const {
  auto column = std::make_shared<Hdf5Column::State>();
  column->file = file_;
  column->path = path;
  B4MRL_ASSIGN_OR_RETURN(column->dataset, file_->OpenDataset(path));
  B4MRL_RETURN_IF_ERROR(column->Describe());
  B4MRL_RETURN_IF_ERROR(column->CheckLayout());
  B4MRL_RETURN_IF_ERROR(column->CheckInflation());
  return Hdf5Column(std::move(column));
}

Result<std::vector<float>> Hdf5Reader::ReadFloats(std::string_view path) const {
  B4MRL_ASSIGN_OR_RETURN(const Hdf5Column column, OpenColumn(path));
  const uint64_t elements = column.rows() * column.width();
  if (elements > kMaxReadFloats) {
    return Refuse(StatusCode::kLimitExceeded, path,
                  fmt::format("has {} elements, allowed: {}", elements, kMaxReadFloats));
  }
  std::vector<float> values(elements);
  B4MRL_RETURN_IF_ERROR(column.Read(0, values));
  return values;
}

Result<double> Hdf5Reader::ReadNumber(std::string_view path) const {
  B4MRL_ASSIGN_OR_RETURN(const Hdf5Column column, OpenColumn(path));
  if (column.rows() * column.width() != 1) {
    return Refuse(StatusCode::kInvalidArgument, path, "is not a single number");
  }
  double value = 0;
  B4MRL_RETURN_IF_ERROR(column.Read(0, std::span(&value, 1)));
  return value;
}

Result<std::string> Hdf5Reader::ReadString(std::string_view path) const {
  B4MRL_ASSIGN_OR_RETURN(const Hdf5Column column, OpenColumn(path));
  if (column.type() != Hdf5Type::kString || column.rows() * column.width() != 1) {
    return Refuse(StatusCode::kInvalidArgument, path, "is not a single fixed-length string");
  }
  const hid_t dataset = column.state_->dataset.get();
  const Hdf5Handle type(H5Dget_type(dataset), H5Tclose);
  std::string text(column.state_->element_bytes, '\0');
  if (H5Dread(dataset, type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, text.data()) < 0) {
    return Refuse(StatusCode::kDataLoss, path, "cannot be read");
  }
  const char padding = H5Tget_strpad(type.get()) == H5T_STR_SPACEPAD ? ' ' : '\0';
  if (padding == '\0') return text.substr(0, text.find('\0'));
  text.erase(text.find_last_not_of(padding) + 1);
  return text;
}

Result<std::string> Hdf5Reader::ReadText(std::string_view path) const {
  B4MRL_ASSIGN_OR_RETURN(const Hdf5Handle dataset, file_->OpenDataset(path));
  const Hdf5Handle type(H5Dget_type(dataset.get()), H5Tclose);
  if (!type.valid() || H5Tis_variable_str(type.get()) <= 0) return ReadString(path);
  const Hdf5Handle space(H5Dget_space(dataset.get()), H5Sclose);
  const Hdf5Handle creation(H5Fget_create_plist(file_->handle.get()), H5Pclose);
  size_t address_bytes = 0, size_bytes = 0;
  H5Pget_sizes(creation.get(), &address_bytes, &size_bytes);
  hsize_t user_block = 0;
  H5Pget_userblock(creation.get(), &user_block);
  const haddr_t address = H5Dget_offset(dataset.get());
  if (H5Sget_simple_extent_npoints(space.get()) != 1 || address_bytes != 8 || size_bytes != 8 ||
      user_block != 0 || address == HADDR_UNDEF) {
    return Refuse(StatusCode::kInvalidArgument, path, "is not a single, plainly stored string");
  }
  Result<std::string> text = ReadHeapString(file_->fd.get(), address, kMaxStringBytes);
  if (!text.ok()) return Refuse(text.status().code(), path, text.status().message());
  return text;
}

}  // namespace b4mrl
