// A program on disk as the streamer pulls it, line by line; mapped, so that ten million lines cost
// no memory that the kernel could not take back. The file is the daemon's own copy: nobody changes
// it.
#pragma once

#include <filesystem>
#include <memory>
#include <string_view>

#include "controller/core/program.h"

namespace reforge {

class ProgramFile final : public ProgramSource {
 public:
  // `lines` as counted when the job was taken in.
  static Result<std::shared_ptr<ProgramFile>> open(const std::filesystem::path& file,
                                                   LineNumber lines);
  ~ProgramFile() override;
  ProgramFile(const ProgramFile&) = delete;
  ProgramFile& operator=(const ProgramFile&) = delete;

  LineNumber line_count() const override { return lines_; }
  // Rising numbers are cheap; going back starts again from the first line.
  Result<std::string_view> line(LineNumber n) override;

 private:
  ProgramFile(std::string_view text, LineNumber lines) : text_(text), lines_(lines) {}

  std::string_view text_;  // mapped; empty for an empty file
  LineNumber lines_;
  LineNumber next_ = 1;  // the line that begins at at_
  std::size_t at_ = 0;
};

}  // namespace reforge
