#include "protocols/sha256.h"

#include <openssl/evp.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>

namespace reforge {
namespace {

struct Digest {
  Digest() : context(EVP_MD_CTX_new(), &EVP_MD_CTX_free) {
    [[maybe_unused]] const int ok = EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr);
    assert(ok == 1);
  }
  void add(const void* bytes, std::size_t count) {
    [[maybe_unused]] const int ok = EVP_DigestUpdate(context.get(), bytes, count);
    assert(ok == 1);
  }
  std::string hex() {
    std::array<unsigned char, EVP_MAX_MD_SIZE> bytes{};
    unsigned int count = 0;
    [[maybe_unused]] const int ok = EVP_DigestFinal_ex(context.get(), bytes.data(), &count);
    assert(ok == 1);
    static constexpr char kDigits[] = "0123456789abcdef";
    std::string text;
    text.reserve(2 * count);
    for (unsigned int i = 0; i < count; ++i) {
      text.push_back(kDigits[bytes[i] >> 4]);
      text.push_back(kDigits[bytes[i] & 15]);
    }
    return text;
  }
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context;
};

}  // namespace

std::string sha256_hex(std::string_view bytes) {
  Digest digest;
  digest.add(bytes.data(), bytes.size());
  return digest.hex();
}

Result<std::string> sha256_of_file(const std::filesystem::path& file) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> in(std::fopen(file.c_str(), "rb"),
                                                           &std::fclose);
  if (!in) return Error{Code::kUnreadable, file.string() + ": " + std::strerror(errno)};
  Digest digest;
  std::array<char, 65536> buffer;
  while (const std::size_t count = std::fread(buffer.data(), 1, buffer.size(), in.get())) {
    digest.add(buffer.data(), count);
  }
  if (std::ferror(in.get()) != 0) {
    return Error{Code::kUnreadable, file.string() + ": cannot be read to its end"};
  }
  return digest.hex();
}

}  // namespace reforge
