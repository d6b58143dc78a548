// PLY 1.0: ASCII, binary little-endian and binary big-endian. Reads x, y, z of "vertex" and the
// list vertex_indices (or vertex_index) of "face"; every other element and property is read over.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "planner/geometry/mesh_parsers.h"

namespace reforge::mesh_parsers {
namespace {

enum class Encoding { kAscii, kLittle, kBig };

struct Type {
  std::size_t bytes = 0;
  char kind = 'i';  // i signed, u unsigned, f floating
};

struct Property {
  std::string name;
  Type type;
  std::optional<Type> count_type;  // of a list
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};

struct Header {
  Encoding encoding = Encoding::kAscii;
  std::vector<Element> elements;
  std::size_t size = 0;  // bytes up to the data
  int lines = 0;
};

std::optional<Type> type_named(std::string_view word) {
  struct Named {
    std::string_view name;
    Type type;
  };
  static constexpr std::array<Named, 16> kTypes{{{"char", {1, 'i'}},
                                                 {"int8", {1, 'i'}},
                                                 {"uchar", {1, 'u'}},
                                                 {"uint8", {1, 'u'}},
                                                 {"short", {2, 'i'}},
                                                 {"int16", {2, 'i'}},
                                                 {"ushort", {2, 'u'}},
                                                 {"uint16", {2, 'u'}},
                                                 {"int", {4, 'i'}},
                                                 {"int32", {4, 'i'}},
                                                 {"uint", {4, 'u'}},
                                                 {"uint32", {4, 'u'}},
                                                 {"float", {4, 'f'}},
                                                 {"float32", {4, 'f'}},
                                                 {"double", {8, 'f'}},
                                                 {"float64", {8, 'f'}}}};
  for (const auto& entry : kTypes) {
    if (entry.name == word) return entry.type;
  }
  return std::nullopt;
}

Result<Header> parse_header(std::string_view bytes, const std::string& name) {
  const auto marker = bytes.find("end_header");
  if (!bytes.starts_with("ply") || marker == bytes.npos) {
    return malformed(name,
                     "a PLY file begins with 'ply' and a header that ends with 'end_header'.");
  }
  Header header;
  auto end = bytes.find('\n', marker);
  if (end == bytes.npos) return malformed(name, "the PLY file ends with its header.");
  header.size = end + 1;
  Scanner scanner(bytes.substr(0, marker), false);
  bool has_format = false;
  while (scanner.next_line()) {
    const auto where = "line " + std::to_string(scanner.line()) + ": ";
    const auto keyword = *scanner.word();
    if (keyword == "ply" || keyword == "comment" || keyword == "obj_info") continue;
    if (keyword == "format") {
      const auto word = scanner.word().value_or("");
      if (word != "ascii" && word != "binary_little_endian" && word != "binary_big_endian") {
        return malformed(name,
                         where + "unknown PLY format '" + std::string(word.substr(0, 24)) + "'.");
      }
      header.encoding = word == "ascii"                  ? Encoding::kAscii
                        : word == "binary_little_endian" ? Encoding::kLittle
                                                         : Encoding::kBig;
      has_format = true;
    } else if (keyword == "element") {
      const auto element = scanner.word();
      const auto word = scanner.word();
      const auto count = word ? to_integer(*word) : std::nullopt;
      if (!element || !count || *count < 0) {
        return malformed(name, where + "expected 'element', a name and a count.");
      }
      header.elements.push_back({std::string(*element), static_cast<std::uint64_t>(*count), {}});
    } else if (keyword == "property") {
      auto word = scanner.word().value_or("");
      Property property;
      if (word == "list") {
        property.count_type = type_named(scanner.word().value_or(""));
        word = scanner.word().value_or("");
        if (!property.count_type || property.count_type->kind == 'f') {
          return malformed(name, where + "a list is counted by an integer type.");
        }
      }
      const auto type = type_named(word);
      const auto property_name = scanner.word();
      if (!type || !property_name || header.elements.empty()) {
        return malformed(name, where + "expected 'property', a type and a name, after an element.");
      }
      property.type = *type;
      property.name = *property_name;
      header.elements.back().properties.push_back(property);
    } else {
      return malformed(name, where + "'" + std::string(keyword.substr(0, 24)) +
                                 "' has no place in a PLY header.");
    }
  }
  header.lines = scanner.line() + 1;
  if (!has_format) return malformed(name, "the PLY header does not state its format.");
  return header;
}

// The data after the header as a sequence of numbers.
class Numbers {
 public:
  Numbers(std::string_view data, Encoding encoding)
      : data_(data), encoding_(encoding), scanner_(data, false) {}

  std::optional<double> next(Type type) {
    if (encoding_ == Encoding::kAscii) {
      const auto word = scanner_.word_across_lines();
      return word ? to_double(*word) : std::nullopt;
    }
    if (data_.size() - at_ < type.bytes) return std::nullopt;
    std::array<char, 8> raw{};
    std::memcpy(raw.data(), data_.data() + at_, type.bytes);
    at_ += type.bytes;
    if (encoding_ == Encoding::kBig) {
      std::reverse(raw.begin(), raw.begin() + static_cast<std::ptrdiff_t>(type.bytes));
    }
    return decode(raw, type);
  }

  std::string place(int header_lines, std::size_t header_size) const {
    return encoding_ == Encoding::kAscii ? "line " + std::to_string(header_lines + scanner_.line())
                                         : "byte " + std::to_string(header_size + at_);
  }

 private:
  template <typename T>
  static double as(const std::array<char, 8>& raw) {
    T value;
    std::memcpy(&value, raw.data(), sizeof value);
    return static_cast<double>(value);
  }
  static double decode(const std::array<char, 8>& raw, Type type) {
    if (type.kind == 'f') return type.bytes == 4 ? as<float>(raw) : as<double>(raw);
    const bool is_signed = type.kind == 'i';
    if (type.bytes == 1) return is_signed ? as<std::int8_t>(raw) : as<std::uint8_t>(raw);
    if (type.bytes == 2) return is_signed ? as<std::int16_t>(raw) : as<std::uint16_t>(raw);
    return is_signed ? as<std::int32_t>(raw) : as<std::uint32_t>(raw);
  }

  std::string_view data_;
  Encoding encoding_;
  Scanner scanner_;
  std::size_t at_ = 0;
};

}  // namespace

Result<TriangleMesh> parse_ply(std::string_view bytes, const std::string& name) {
  const auto header = parse_header(bytes, name);
  if (!header) return header.error();
  Numbers numbers(bytes.substr(header->size), header->encoding);
  TriangleMesh mesh;
  std::vector<double> values;  // of the property being read
  for (const Element& element : header->elements) {
    if (element.properties.empty()) continue;
    // Every property takes at least one byte: never loop over more elements than can be there.
    if (element.count > bytes.size()) {
      return malformed(name, "the header promises " + std::to_string(element.count) + " of '" +
                                 element.name + "', more than the file can hold.");
    }
    for (std::uint64_t i = 0; i < element.count; ++i) {
      Vec3 vertex = Vec3::Constant(std::nan(""));
      for (const Property& property : element.properties) {
        double count = 1;
        if (property.count_type) count = numbers.next(*property.count_type).value_or(-1);
        values.clear();
        for (double k = 0; k < count; ++k) {
          const auto value = numbers.next(property.type);
          if (!value) break;
          values.push_back(*value);
        }
        if (static_cast<double>(values.size()) != count) {
          return malformed(name, numbers.place(header->lines, header->size) + ": '" + element.name +
                                     "' number " + std::to_string(i) + " of " +
                                     std::to_string(element.count) + " is cut off or no number.");
        }
        if (element.name == "vertex" && property.name.size() == 1 && !property.count_type) {
          const int axis = property.name[0] - 'x';
          if (axis >= 0 && axis < 3) vertex[axis] = values[0];
        }
        if (element.name == "face" && property.count_type &&
            (property.name == "vertex_indices" || property.name == "vertex_index")) {
          if (values.size() < 3) {
            return malformed(name, numbers.place(header->lines, header->size) +
                                       ": a face has at least 3 corners.");
          }
          for (const double index : values) {
            if (!(index >= 0 && index < static_cast<double>(mesh.vertices.size()))) {
              return malformed(name,
                               numbers.place(header->lines, header->size) +
                                   ": the face refers to a vertex that does not exist; there are " +
                                   std::to_string(mesh.vertices.size()) + ".");
            }
          }
          for (std::size_t k = 2; k < values.size(); ++k) {
            mesh.triangles.push_back({static_cast<std::uint32_t>(values[0]),
                                      static_cast<std::uint32_t>(values[k - 1]),
                                      static_cast<std::uint32_t>(values[k])});
          }
        }
      }
      if (element.name == "vertex") mesh.vertices.push_back(vertex);
    }
  }
  if (mesh.triangles.empty()) return malformed(name, "the PLY file has no faces.");
  return mesh;
}

}  // namespace reforge::mesh_parsers
