// One serial link: libserialport opens and configures it, the io_context drives its handle.
//
// 8N1, no flow control. The port is held exclusively (flock and TIOCEXCL): nobody else's bytes can
// slip into a job. HUPCL is cleared, so that closing the port, or dying, does not reset a UNO; the
// first opening after power-up still does, and its banner has to be awaited. What was waiting in
// the port when it is opened is thrown away. A hang-up (unplugged, or the virtual rig has gone) is
// told once by on_lost; the port is closed then. Lives in the io_context's thread. Handlers are
// never called from inside open, write or close.
//
// Paced, a port hands the kernel no more than kKernelBytes (or a millisecond of the line, which is
// more above 120,000 baud) that the line cannot have carried yet, reckoned by our own clock at 10
// bits a byte: an urgent byte never stands behind a queue in the kernel. Urgent bytes are not
// held back. A virtual rig's port is not paced: its UART is, in virtual time.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "protocols/result.h"

namespace boost::asio {
class io_context;
}

namespace reforge {

class SerialPort {
 public:
  struct Handlers {
    std::function<void(std::string_view bytes)> on_bytes;
    std::function<void(std::string sentence)> on_lost;
    std::function<void()> on_written;  // bytes that had to wait for the kernel are gone
  };

  SerialPort(boost::asio::io_context& io, Handlers handlers);
  ~SerialPort();
  SerialPort(const SerialPort&) = delete;
  SerialPort& operator=(const SerialPort&) = delete;

  struct How {
    int baud = 0;
    bool paced = false;
    // The handle under which an earlier daemon had it open, kept by systemd since: the device has
    // seen no close. Given up once the port is open.
    std::optional<int> kept;
  };
  static constexpr int kKernelBytes = 12;

  Status open(const std::string& path, const How& how);
  void close();
  bool is_open() const;
  int handle() const;  // of the open port

  // Bytes leave in order; urgent ones before all that still wait here. Ignored while closed.
  void write(std::string_view bytes, bool urgent);
  void drop_unsent();

  // Of all openings. counted_from() replaces what has been read: the virtual rig's count.
  std::uint64_t bytes_read() const;
  std::uint64_t bytes_written() const;
  void counted_from(std::uint64_t bytes_read);

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace reforge
