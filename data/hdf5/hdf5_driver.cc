#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <mutex>

#include "data/hdf5/hdf5_handle.h"

namespace b4mrl {
namespace {

// An open file of the driver; the library casts between DriverFile and its first member.
struct DriverFile {
  H5FD_t base;
  haddr_t end_of_allocation;
  Hdf5DriverState* state;
};

DriverFile* Cast(H5FD_t* file) { return reinterpret_cast<DriverFile*>(file); }
const DriverFile* Cast(const H5FD_t* file) { return reinterpret_cast<const DriverFile*>(file); }

void Remember(Hdf5DriverState* state, int error_number) {
  if (state->error_number == 0) state->error_number = error_number;
}

H5FD_t* Open(const char*, unsigned, hid_t access, haddr_t) {
  const void* info = H5Pget_driver_info(access);
  if (info == nullptr) return nullptr;
  auto* file = new DriverFile{};
  file->state = *static_cast<Hdf5DriverState* const*>(info);
  return &file->base;
}

herr_t Close(H5FD_t* file) {
  delete Cast(file);
  return 0;
}

int Compare(const H5FD_t* a, const H5FD_t* b) {
  const auto* left = Cast(a)->state;
  const auto* right = Cast(b)->state;
  return left < right ? -1 : (left > right ? 1 : 0);
}

herr_t Query(const H5FD_t*, unsigned long* flags) {  // NOLINT: the library's type
  if (flags != nullptr) {
    *flags = H5FD_FEAT_AGGREGATE_METADATA | H5FD_FEAT_ACCUMULATE_METADATA | H5FD_FEAT_DATA_SIEVE |
             H5FD_FEAT_AGGREGATE_SMALLDATA;
  }
  return 0;
}

haddr_t EndOfAllocation(const H5FD_t* file, H5FD_mem_t) { return Cast(file)->end_of_allocation; }

herr_t SetEndOfAllocation(H5FD_t* file, H5FD_mem_t, haddr_t address) {
  Cast(file)->end_of_allocation = address;
  return 0;
}

haddr_t EndOfFile(const H5FD_t* file, H5FD_mem_t) { return Cast(file)->state->file_bytes; }

herr_t Read(H5FD_t* file, H5FD_mem_t, hid_t, haddr_t address, size_t size, void* buffer) {
  Hdf5DriverState* state = Cast(file)->state;
  auto* out = static_cast<char*>(buffer);
  while (size > 0) {
    const ssize_t got = pread(state->fd, out, size, static_cast<off_t>(address));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) Remember(state, errno);
    if (got <= 0 && !state->writable) return -1;
    if (got <= 0) {  // beyond the end of a file that is being written
      std::memset(out, 0, size);
      return 0;
    }
    out += got;
    address += static_cast<haddr_t>(got);
    size -= static_cast<size_t>(got);
  }
  return 0;
}

herr_t Write(H5FD_t* file, H5FD_mem_t, hid_t, haddr_t address, size_t size, const void* buffer) {
  Hdf5DriverState* state = Cast(file)->state;
  state->file_bytes = std::max<uint64_t>(state->file_bytes, address + size);
  const auto* in = static_cast<const char*>(buffer);
  while (size > 0 && state->error_number == 0) {
    const ssize_t written = pwrite(state->fd, in, size, static_cast<off_t>(address));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      Remember(state, written < 0 ? errno : ENOSPC);
      break;
    }
    in += written;
    address += static_cast<haddr_t>(written);
    size -= static_cast<size_t>(written);
  }
  return 0;
}

herr_t Truncate(H5FD_t* file, hid_t, hbool_t) {
  DriverFile* own = Cast(file);
  Hdf5DriverState* state = own->state;
  if (!state->writable || own->end_of_allocation == state->file_bytes) return 0;
  if (state->error_number == 0 &&
      ftruncate(state->fd, static_cast<off_t>(own->end_of_allocation)) != 0) {
    Remember(state, errno);
  }
  state->file_bytes = own->end_of_allocation;
  return 0;
}

hid_t RegisterDriver() {
  static constexpr haddr_t kMaxAddress = (haddr_t{1} << 62) - 1;
  static H5FD_class_t driver = [] {
    H5FD_class_t made{};
    made.name = "b4mrl";
    made.maxaddr = kMaxAddress;
    made.fc_degree = H5F_CLOSE_STRONG;
    made.fapl_size = sizeof(Hdf5DriverState*);
    made.open = Open;
    made.close = Close;
    made.cmp = Compare;
    made.query = Query;
    made.get_eoa = EndOfAllocation;
    made.set_eoa = SetEndOfAllocation;
    made.get_eof = EndOfFile;
    made.read = Read;
    made.write = Write;
    made.truncate = Truncate;
    const H5FD_mem_t map[H5FD_MEM_NTYPES] = H5FD_FLMAP_DICHOTOMY;
    std::copy(std::begin(map), std::end(map), made.fl_map);
    return made;
  }();
  return H5FDregister(&driver);
}

hid_t driver_id = -1;

}  // namespace

void InitialiseHdf5() {
  static std::once_flag once;
  std::call_once(once, [] {
    H5open();
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    H5PLset_loading_state(0);
    driver_id = RegisterDriver();
  });
  // The automatic printing of errors is a property of each thread.
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

Hdf5Handle Hdf5DriverAccess(Hdf5DriverState* state) {
  InitialiseHdf5();
  Hdf5Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_driver(access.get(), driver_id, &state);
  H5Pset_fclose_degree(access.get(), H5F_CLOSE_STRONG);
  return access;
}

}  // namespace b4mrl
