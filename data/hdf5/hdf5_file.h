// HDF5 behind two small classes; only files of data/hdf5 include hdf5.h.
//
// Hdf5Reader treats the file as hostile. HDF5 1.10.8 has known crashes on crafted files, so files
// of users are only opened inside the importer's sandbox; beyond that the reader follows
// hard links only, loads no plugins, and refuses external and virtual storage, variable-length,
// reference, compound and opaque types, filters other than deflate, shuffle and fletcher32, and any
// declared size above proto/base/limits.h or beyond what the stored bytes (holes not counted) can
// inflate to, before it allocates. The library reads through this project's own file driver, so it
// never opens a path by itself. ReadText alone takes a variable-length string, without the library.
//
// Hdf5Writer makes a file that appears complete or not at all (see atomic_file.h). Equal calls give
// equal bytes: no timestamps, and buffering makes the layout independent of how appends are split.
// Every column and every array of WriteArray carries fletcher32 checksums.
//
// Paths inside a file are "/"-separated ("metadata/policy/fc0/weight"). Arrays are row-major with
// one or two dimensions; a one-dimensional array and an (N, 1) array both have width 1. Thread
// rule: an object belongs to one thread. The HDF5 library locks itself globally. Errors: kIoError
// (open, full disk), kDataLoss (not HDF5, truncated, checksum), kUnknownName (no such dataset),
// kInvalidArgument (wrong type, rank or size), kLimitExceeded (declared size).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "data/files/atomic_file.h"
#include "proto/base/status.h"

namespace b4mrl {

// Largest number of elements that ReadFloats reads; writers of such arrays must not exceed it. An
// array of so many floats is also the largest chunk that any column may have.
inline constexpr uint64_t kMaxReadFloats = 80ull << 20;

enum class Hdf5Type { kFloat32, kFloat64, kInteger, kBool, kString };
std::string_view Hdf5TypeName(Hdf5Type type);

// An open dataset; keep it while reading consecutive rows, because it holds the decompressed chunk.
// It may outlive the reader that opened it. Copies share the open dataset.
class Hdf5Column {
 public:
  const std::string& path() const;
  Hdf5Type type() const;
  // The stored shape: empty for a scalar, otherwise one or two extents.
  const std::vector<uint64_t>& shape() const;
  uint64_t rows() const;   // 1 for a scalar
  uint64_t width() const;  // elements of a row
  // Rows per read with which consecutive reads decompress every chunk once.
  uint64_t block_rows() const;

  // Read rows [first_row, first_row + out.size() / width()). Read rounds float64 to float32 and
  // turns integers and booleans into floating-point numbers. ReadFlags needs an integer or bool
  // column and turns every nonzero element into 1.
  Status Read(uint64_t first_row, std::span<float> out) const;
  Status Read(uint64_t first_row, std::span<double> out) const;
  Status ReadFlags(uint64_t first_row, std::span<uint8_t> out) const;

 private:
  friend class Hdf5Reader;
  struct State;
  explicit Hdf5Column(std::shared_ptr<const State> state) : state_(std::move(state)) {}
  std::shared_ptr<const State> state_;
};

struct Hdf5OpenFile;  // internal to hdf5_reader.cc

// An open file. Copies share it.
class Hdf5Reader {
 public:
  static Result<Hdf5Reader> Open(const std::string& path);

  // Whether the file has an object at `path`, reached by hard links alone.
  bool Exists(std::string_view path) const;
  Result<Hdf5Column> OpenColumn(std::string_view path) const;
  // Reads a whole dataset of at most kMaxReadFloats elements.
  Result<std::vector<float>> ReadFloats(std::string_view path) const;
  // Reads a scalar number, or the only element of an array.
  Result<double> ReadNumber(std::string_view path) const;
  // Reads a scalar fixed-length string of at most 64 KiB, without its padding.
  Result<std::string> ReadString(std::string_view path) const;
  // Reads a scalar string of fixed length or, as h5py writes strings, of variable length; at most
  // 64 KiB.
  Result<std::string> ReadText(std::string_view path) const;

 private:
  explicit Hdf5Reader(std::shared_ptr<const Hdf5OpenFile> file) : file_(std::move(file)) {}
  std::shared_ptr<const Hdf5OpenFile> file_;
};

struct Hdf5ColumnOptions {
  Hdf5Type type = Hdf5Type::kFloat32;  // not kString
  uint64_t width = 0;                  // 0: one-dimensional
  uint64_t chunk_rows = 8192;
  int compression_level = 1;  // deflate level 1..9 after shuffle; 0: no compression
};

class Hdf5Writer {
 public:
  using ColumnId = size_t;

  static Result<Hdf5Writer> Create(const std::string& path);
  Hdf5Writer(Hdf5Writer&&) noexcept;
  Hdf5Writer& operator=(Hdf5Writer&&) noexcept;
  ~Hdf5Writer();

  // Creates a column that grows by Append, and the groups on its path. Each Append has whole rows
  // of the column's type (uint8_t for bool and integer columns).
  Result<ColumnId> CreateColumn(std::string_view path, const Hdf5ColumnOptions& options);
  Status Append(ColumnId column, std::span<const float> values);
  Status Append(ColumnId column, std::span<const double> values);
  Status Append(ColumnId column, std::span<const uint8_t> values);

  // Writes a small array of fixed shape. No extent is 0, and their product is values.size().
  Status WriteArray(std::string_view path, std::span<const float> values,
                    std::span<const uint64_t> shape);
  // Creates an array of known extents, one or two and none of them 0, and the groups on its path;
  // WriteRows fills it. It is stored without chunks, compression and checksum, which would take
  // more space than the rows of a short array. 300 bytes of the file describe it, and no memory.
  Status CreateArray(std::string_view path, Hdf5Type type, std::span<const uint64_t> shape);
  // Writes whole rows, of the array's type (uint8_t for bool and integer arrays), from `first_row`.
  Status WriteRows(std::string_view array, uint64_t first_row, std::span<const float> values);
  Status WriteRows(std::string_view array, uint64_t first_row, std::span<const uint8_t> values);
  // Creates a group and those on its path, as far as they do not exist.
  Status CreateGroup(std::string_view path);
  // Writes a whole number as an attribute of a group that exists.
  Status WriteAttribute(std::string_view group, std::string_view name, int64_t value);
  Status WriteString(std::string_view path, std::string_view text);
  Status WriteInteger(std::string_view path, int64_t value);
  Status WriteNumber(std::string_view path, double value);

  // Flushes and fsyncs the file and renames it into place. After an error no file appears.
  Status Commit(Existing existing = Existing::kReplace);

 private:
  struct State;
  explicit Hdf5Writer(std::unique_ptr<State> state);
  Status AppendBytes(ColumnId column, Hdf5Type given, std::span<const std::byte> bytes);
  Status WriteBytes(std::string_view array, uint64_t first_row, std::span<const std::byte> bytes);
  std::unique_ptr<State> state_;
};

}  // namespace b4mrl
