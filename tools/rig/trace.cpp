#include "tools/rig/trace.h"

#include <cerrno>
#include <cmath>
#include <cstring>
#include <memory>

namespace reforge {

Result<std::unique_ptr<TraceFile>> TraceFile::create(const std::filesystem::path& file) {
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  if (!out) {
    return Error{Code::kUnreadable,
                 "The trace " + file.string() + " cannot be written: " + std::strerror(errno)};
  }
  return std::unique_ptr<TraceFile>(new TraceFile(std::move(out)));
}

void TraceFile::write(const TraceRecord& record) {
  nlohmann::ordered_json line;
  // Microseconds are finer than anything here happens to matter, and print short.
  line["t"] = std::round(static_cast<double>(record.ns) / 1e3) / 1e6;
  line["ev"] = record.event;
  line.update(record.fields);
  out_ << line.dump(-1, ' ', true, nlohmann::ordered_json::error_handler_t::replace) << '\n'
       << std::flush;
}

}  // namespace reforge
