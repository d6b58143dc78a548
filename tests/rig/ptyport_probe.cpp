// A program that knows nothing of virtual rigs: opens a serial port by the real libserialport,
// sends a line, prints the answer. Run by ports_test with libreforge-ptyport.so preloaded.
//
//     ptyport_probe PORT echo | lower-dtr | wait
#include <libserialport.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <string>

namespace {

int fail(const char* what) {
  char* why = sp_last_error_message();
  std::fprintf(stderr, "%s: %s\n", what, why);
  sp_free_error_message(why);
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  const std::string mode = argv[2];
  const std::string name = std::filesystem::canonical(argv[1]);
  sp_port* port = nullptr;
  if (sp_get_port_by_name(name.c_str(), &port) != SP_OK) return fail("by name");
  if (sp_open(port, SP_MODE_READ_WRITE) != SP_OK) return fail("open");
  if (sp_set_baudrate(port, 115200) != SP_OK || sp_set_bits(port, 8) != SP_OK ||
      sp_set_parity(port, SP_PARITY_NONE) != SP_OK || sp_set_stopbits(port, 1) != SP_OK ||
      sp_set_flowcontrol(port, SP_FLOWCONTROL_NONE) != SP_OK) {
    return fail("configure");
  }
  if (mode == "lower-dtr" && sp_set_dtr(port, SP_DTR_OFF) != SP_OK) return fail("dtr");
  const int written = sp_blocking_write(port, "hello\n", 6, 1000);  // bytes, or an error below 0
  if (written != 6) return fail("write");
  std::string answer;
  while (answer.find('\n') == std::string::npos) {
    std::array<char, 64> bytes;
    const int n = sp_blocking_read_next(port, bytes.data(), bytes.size(), 10000);
    if (n <= 0) return fail("read");
    answer.append(bytes.data(), static_cast<std::size_t>(n));
  }
  std::fputs(answer.c_str(), stdout);
  std::fflush(stdout);
  if (mode == "wait") pause();
  sp_close(port);
  sp_free_port(port);
  return 0;
}
