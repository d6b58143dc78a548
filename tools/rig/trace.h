// The rig's trace: what physically happened, one JSON object a line (FORMATS.md, "Rig trace").
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "protocols/result.h"

namespace reforge {

struct TraceRecord {
  int64_t ns;
  std::string event;
  nlohmann::ordered_json fields = nlohmann::ordered_json::object();
};

class Trace {
 public:
  virtual ~Trace() = default;
  virtual void write(const TraceRecord& record) = 0;
};

// Written through at every line: a reader may follow, and a killed rig loses nothing.
class TraceFile final : public Trace {
 public:
  static Result<std::unique_ptr<TraceFile>> create(const std::filesystem::path& file);
  void write(const TraceRecord& record) override;
  // False once something could not be written.
  bool good() const { return out_.good(); }

 private:
  explicit TraceFile(std::ofstream out) : out_(std::move(out)) {}
  std::ofstream out_;
};

}  // namespace reforge
