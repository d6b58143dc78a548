// libreforge-ptyport.so, for LD_PRELOAD: lets programs that use the real libserialport (0.1.1) run
// on the virtual rig's pseudo-terminals, unchanged.
//
// A pseudo-terminal has no modem lines and no entry under /sys/class/tty. This library
//  - answers TIOCMGET, TIOCMSET, TIOCMBIS and TIOCMBIC for a pseudo-terminal after the kernel has
//    refused them (ENOTTY);
//  - lets lstat and readlink find /sys/class/tty/pts/N;
//  - tells the rig when a port is opened or closed and when DTR changes (FORMATS.md, "Modem
//    lines"), over the socket named by REFORGE_RIG_DTR, if that is set. The connection is held as
//    long as the port is open, so that the rig sees a killed process as the closing it is.
// Everything else goes to the kernel as it is. Linux, x86-64 and arm64. Limits: descriptors made by
// dup are not followed; at most 32 ports open at once.
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/sysmacros.h>
#include <sys/un.h>
#include <unistd.h>

enum { kPortsMax = 32, kFirstPtyMajor = 136, kLastPtyMajor = 143 };

struct open_port {
  int fd;     // 0 = free: descriptor 0 is no port of ours
  int rig;    // connection to the rig, -1 = none
  int lines;  // TIOCM_ bits
};

static struct open_port ports[kPortsMax];
static pthread_mutex_t ports_lock = PTHREAD_MUTEX_INITIALIZER;

// The number of a pseudo-terminal's slave side, or -1.
static int pty_number(int fd) {
  struct stat about;
  if (fstat(fd, &about) != 0 || !S_ISCHR(about.st_mode)) return -1;
  const int device = (int)major(about.st_rdev);
  if (device < kFirstPtyMajor || device > kLastPtyMajor) return -1;
  return (device - kFirstPtyMajor) * 256 + (int)minor(about.st_rdev);
}

static struct open_port* find_port(int fd) {
  for (int i = 0; i < kPortsMax; ++i) {
    if (ports[i].fd == fd) return &ports[i];
  }
  return NULL;
}

static int connect_to_rig(void) {
  const char* path = getenv("REFORGE_RIG_DTR");
  struct sockaddr_un address = {.sun_family = AF_UNIX};
  if (path == NULL || strlen(path) >= sizeof address.sun_path) return -1;
  strcpy(address.sun_path, path);
  const int rig = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
  if (rig < 0) return -1;
  if (connect(rig, (struct sockaddr*)&address, sizeof address) != 0) {
    syscall(SYS_close, rig);
    return -1;
  }
  return rig;
}

static void tell_rig(const struct open_port* port, const char* message) {
  // A rig that has gone away needs to know nothing any more.
  if (port->rig >= 0) (void)!send(port->rig, message, strlen(message), MSG_NOSIGNAL);
}

// The kernel raises DTR and RTS when a terminal is opened; the other lines are what a board gives.
static void port_opened(int fd, int number) {
  struct open_port* port = find_port(0);
  if (port == NULL) return;
  port->fd = fd;
  port->rig = connect_to_rig();
  port->lines = TIOCM_DTR | TIOCM_RTS | TIOCM_CTS | TIOCM_DSR | TIOCM_CAR;
  char message[32];
  snprintf(message, sizeof message, "open /dev/pts/%d", number);
  tell_rig(port, message);
}

static int noticed(int fd) {
  const int saved = errno;
  const int number = fd > 0 ? pty_number(fd) : -1;
  if (number >= 0) {
    pthread_mutex_lock(&ports_lock);
    port_opened(fd, number);
    pthread_mutex_unlock(&ports_lock);
  }
  errno = saved;
  return fd;
}

static int open_file(const char* path, int flags, mode_t mode) {
  return noticed((int)syscall(SYS_openat, AT_FDCWD, path, flags, mode));
}

static mode_t mode_argument(int flags, va_list arguments) {
  const int creates = (flags & O_CREAT) != 0 || (flags & O_TMPFILE) == O_TMPFILE;
  return creates ? va_arg(arguments, mode_t) : 0;
}

int open(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = mode_argument(flags, arguments);
  va_end(arguments);
  return open_file(path, flags, mode);
}

int open64(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = mode_argument(flags, arguments);
  va_end(arguments);
  return open_file(path, flags, mode);
}

// What open() becomes in libraries built with _FORTIFY_SOURCE.
int __open_2(const char* path, int flags) {
  return open_file(path, flags, 0);
}
int __open64_2(const char* path, int flags) {
  return open_file(path, flags, 0);
}

int close(int fd) {
  if (fd > 0) {
    pthread_mutex_lock(&ports_lock);
    struct open_port* port = find_port(fd);
    if (port != NULL) {
      port->fd = 0;
      if (port->rig >= 0) syscall(SYS_close, port->rig);
    }
    pthread_mutex_unlock(&ports_lock);
  }
  return (int)syscall(SYS_close, fd);
}

static int modem_lines(struct open_port* port, unsigned long request, int* argument) {
  const int before = port->lines;
  switch (request) {
    case TIOCMGET:
      *argument = port->lines;
      return 0;
    case TIOCMSET:
      port->lines =
          (port->lines & ~(TIOCM_DTR | TIOCM_RTS)) | (*argument & (TIOCM_DTR | TIOCM_RTS));
      break;
    case TIOCMBIS:
      port->lines |= *argument & (TIOCM_DTR | TIOCM_RTS);
      break;
    default:
      port->lines &= ~(*argument & (TIOCM_DTR | TIOCM_RTS));
      break;
  }
  if ((before ^ port->lines) & TIOCM_DTR) {
    tell_rig(port, port->lines & TIOCM_DTR ? "dtr 1" : "dtr 0");
  }
  return 0;
}

int ioctl(int fd, unsigned long request, ...) {
  va_list arguments;
  va_start(arguments, request);
  void* argument = va_arg(arguments, void*);
  va_end(arguments);
  const int result = (int)syscall(SYS_ioctl, fd, request, argument);
  if (result != -1 || errno != ENOTTY || argument == NULL) return result;
  if (request != TIOCMGET && request != TIOCMSET && request != TIOCMBIS && request != TIOCMBIC) {
    return result;
  }
  pthread_mutex_lock(&ports_lock);
  struct open_port* port = find_port(fd);
  const int answered = port != NULL ? modem_lines(port, request, argument) : -1;
  pthread_mutex_unlock(&ports_lock);
  errno = ENOTTY;
  return answered;
}

// N of "/sys/class/tty/pts/N" if that pseudo-terminal exists, otherwise -1.
static int sys_entry(const char* path) {
  static const char prefix[] = "/sys/class/tty/pts/";
  if (path == NULL || strncmp(path, prefix, sizeof prefix - 1) != 0) return -1;
  char device[32];
  char rest;
  int number;
  if (sscanf(path + sizeof prefix - 1, "%d%c", &number, &rest) != 1 || number < 0) return -1;
  snprintf(device, sizeof device, "/dev/pts/%d", number);
  return faccessat(AT_FDCWD, device, F_OK, 0) == 0 ? number : -1;
}

static int lstat_file(const char* path, struct stat* about) {
  const int result = fstatat(AT_FDCWD, path, about, AT_SYMLINK_NOFOLLOW);
  if (result == 0 || sys_entry(path) < 0) return result;
  memset(about, 0, sizeof *about);
  about->st_mode = S_IFLNK | 0777;
  about->st_nlink = 1;
  return 0;
}

int lstat(const char* path, struct stat* about) {
  return lstat_file(path, about);
}

// On 64-bit Linux struct stat64 is struct stat.
int lstat64(const char* path, struct stat64* about) {
  return lstat_file(path, (struct stat*)about);
}

// What lstat was called before glibc 2.33; libserialport of Debian 12 still asks for it.
int __lxstat(int version, const char* path, struct stat* about) {
  (void)version;
  return lstat_file(path, about);
}

ssize_t readlink(const char* restrict path, char* restrict target, size_t size) {
  const ssize_t length = readlinkat(AT_FDCWD, path, target, size);
  if (length >= 0) return length;
  const int number = sys_entry(path);
  if (number < 0) return length;
  char device[64];
  snprintf(device, sizeof device, "../../devices/platform/reforge-rig/tty/pts/%d", number);
  const size_t whole = strlen(device);
  const size_t fits = whole < size ? whole : size;
  memcpy(target, device, fits);
  return (ssize_t)fits;
}
