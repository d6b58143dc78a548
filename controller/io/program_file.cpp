#include "controller/io/program_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cassert>
#include <cerrno>
#include <cstring>

namespace reforge {

Result<std::shared_ptr<ProgramFile>> ProgramFile::open(const std::filesystem::path& file,
                                                       LineNumber lines) {
  const auto failed = [&] {
    return Error{Code::kUnreadable, file.string() + ": " + std::strerror(errno) + "."};
  };
  const int handle = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
  if (handle < 0) return failed();
  struct stat about {};
  void* bytes = MAP_FAILED;
  const bool known = fstat(handle, &about) == 0;
  const auto size = static_cast<std::size_t>(about.st_size);
  if (known && size > 0) bytes = mmap(nullptr, size, PROT_READ, MAP_PRIVATE, handle, 0);
  const bool usable = known && (size == 0 || bytes != MAP_FAILED);
  const Error error = usable ? Error{} : failed();
  ::close(handle);
  if (!usable) return error;
  const std::string_view text =
      size == 0 ? std::string_view() : std::string_view(static_cast<const char*>(bytes), size);
  return std::shared_ptr<ProgramFile>(new ProgramFile(text, lines));
}

ProgramFile::~ProgramFile() {
  if (!text_.empty()) munmap(const_cast<char*>(text_.data()), text_.size());
}

Result<std::string_view> ProgramFile::line(LineNumber n) {
  assert(n >= 1 && n <= lines_);
  if (n < next_) {
    next_ = 1;
    at_ = 0;
  }
  while (at_ < text_.size()) {
    const std::size_t end = std::min(text_.find('\n', at_), text_.size());
    std::string_view text = text_.substr(at_, end - at_);
    at_ = end + 1;
    if (next_++ != n) continue;
    if (text.ends_with('\r')) text.remove_suffix(1);
    return text;
  }
  return Error{Code::kMalformed, "The program ends before its line " + std::to_string(n) +
                                     "; it was changed after it was submitted."};
}

}  // namespace reforge
