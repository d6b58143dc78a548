// A serial port of the virtual rig: the master side of a pseudo-terminal, raw, with a symbolic link
// to its slave side at a stable path. The slave is kept open here too, so that a program that
// closes it does not hang up the master (EIO). Non-blocking.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <utility>

#include "protocols/result.h"
#include "tools/rig/file_handle.h"

namespace reforge {

class PtyPort {
 public:
  // Replaces a link an earlier run left behind, and nothing else. Removed with the object.
  static Result<PtyPort> create(const std::filesystem::path& link);
  PtyPort(PtyPort&& other) noexcept;
  PtyPort& operator=(PtyPort&&) = delete;
  ~PtyPort();

  int fd() const { return master_.get(); }
  const std::filesystem::path& link() const { return link_; }
  const std::string& device() const { return device_; }  // "/dev/pts/N"

  // The cable is pulled: programs see a hang-up and the link is gone, until plug(), which makes a
  // new pseudo-terminal. swap_names: who is plugged in under which name.
  void unplug();
  Result<bool> plug();
  bool plugged() const { return static_cast<bool>(master_); }
  static void swap_names(PtyPort& a, PtyPort& b) { std::swap(a.link_, b.link_); }

  std::string read();  // whatever is there, perhaps nothing
  // How many bytes were taken; the rest is lost, as on a wire whose host does not listen.
  size_t write(std::string_view bytes);
  // Whether closing the port drops DTR (HUPCL), as the program that uses it has set it.
  bool drops_dtr_on_close() const;

 private:
  PtyPort(FileHandle master, FileHandle slave, std::string device, std::filesystem::path link);

  FileHandle master_, slave_;
  std::string device_;
  std::filesystem::path link_;
};

}  // namespace reforge
