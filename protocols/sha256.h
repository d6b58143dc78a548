// SHA-256, the hash that binds certificates, headers and rig files to bytes. Lower-case
// hexadecimal.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "protocols/result.h"

namespace reforge {

std::string sha256_hex(std::string_view bytes);
// Of a file's bytes, read in pieces: a program need not fit into memory.
Result<std::string> sha256_of_file(const std::filesystem::path& file);

}  // namespace reforge
