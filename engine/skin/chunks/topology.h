#pragma once
// What fingers of one archetype share: connectivity and the symbolic block Cholesky factor.

#include <array>
#include <string>
#include <vector>

#include "engine/skin/factor/supernodes.h"
#include "meshes/tet_mesh.h"

namespace palpate {

/// Lower triangle of a symmetric matrix of 3x3 blocks after elimination-order permutation, stored by
/// columns, with the update program of its Cholesky factor (add_updates). Blocks are numbered 0..block_count-1.
struct BlockPattern {
    int columns = 0;
    int block_count = 0;
    std::vector<int> column_start;  ///< [columns + 1] first block of each column: its diagonal block
    std::vector<int> row;           ///< [block_count] row of each block, ascending within a column
    std::vector<int> update_start;  ///< [block_count + 1] range in update_a / update_b
    std::vector<int> update_a;      ///< block(i,j) -= sum over updates of block a times block b^T
    std::vector<int> update_b;

    std::vector<unsigned char> filled;  ///< [block_count] 1: only the factor has it, the matrix is zero; empty: unknown

    /// Whether the matrix has a block.
    bool in_matrix(int b) const { return filled.empty() || filled[std::size_t(b)] == 0; }
    /// Block number of (row, column), row >= column; -1 where the factor has none.
    int find(int row, int column) const;
};

/// Symbolic factorisation of a graph: `adjacency[i]` lists the neighbours of i in elimination order.
BlockPattern factor_pattern(const std::vector<std::vector<int>>& adjacency);
/// Writes the update program, which only factor_blocks needs, and which grows faster than the factor.
void add_updates(BlockPattern& pattern);

/// A sample inside a face of the pad.
struct FaceSample {
    std::array<int, 3> node;       ///< all free
    std::array<int, 3> sample;     ///< their numbers among the samples that are nodes
    std::array<double, 3> weight;  ///< barycentric
    std::array<int, 6> block;      ///< of the nodes' pairs 00, 10, 11, 20, 21, 22
};

/// A corner of a face around a node of the pad, and an edge of the pad.
struct SkinCorner {
    int sample;            ///< at the node
    int node, next, last;  ///< of the face
};
struct SkinEdge {
    std::array<int, 2> node, sample;
};

/// Elements that share one volume term, and the nodes that it couples.
struct VolumePatch {
    int first = 0, count = 0;            ///< elements
    int first_node = 0, node_count = 0;  ///< in patch_nodes
    int first_block = 0;                 ///< in patch_blocks: of the node pairs 00, 10, 11, 20, ...
};
inline constexpr int most_patch_elements = 16;

/// Elements whose mean deformation strain limits hold.
struct LimitPatch {
    int first_node = 0, node_count = 0;  ///< in limit_nodes
    int first_block = 0;                 ///< in limit_blocks: of the node pairs 00, 10, 11, 20, ...
};

/// What of an element's volume is in a limit patch.
struct LimitPart {
    int element, patch;
    double share;
};

/// Elements with a face in the skin whose membranes resist their mean stretch.
struct MembranePatch {
    int first = 0, count = 0;            ///< in membrane_elements
    int first_node = 0, node_count = 0;  ///< in membrane_nodes: those that move what is in the skin
    int first_block = 0;                 ///< in membrane_blocks: of the node pairs 00, 10, 11, 20, ...
};
inline constexpr int most_membrane_elements = 8;
inline constexpr int membrane_registers = 4;  ///< of elements whose membranes are taken together, of a finger alone

/// Connectivity of one skin. Bone nodes are fixed in the bone; the unknowns are the free nodes, then the bone's
/// position, then its rotation: the bone comes last in the elimination, so its 6x6 block is the Schur complement
/// of the skin. Nodes keep the numbers of the mesh; the bone's two unknowns follow them.
struct SkinTopology {
    int node_count = 0;
    int bone_position = 0;            ///< number of the bone's position: node_count
    int bone_rotation = 0;            ///< node_count + 1
    std::vector<int> unknowns;        ///< free nodes, bone_position, bone_rotation
    std::vector<int> elimination;     ///< [node_count + 2] -> elimination position; -1 for bone nodes
    BlockPattern pattern;             ///< of the unknowns
    SupernodeFactor supernodes;       ///< the same factor in panels
    int block_count = 0;              ///< the pattern's, then blocks of bone nodes, which `bone_edges` and
                                      ///< `bone_pairs` carry over to the bone's unknowns
    std::vector<int> diagonal_block;  ///< [node_count + 2]

    std::vector<int> mesh_element;  ///< [element] its number in the mesh: elements inside the bone are left out
    std::vector<std::array<int, 4>> elements;        ///< nodes: free ones in elimination order, then bone nodes
    std::vector<std::array<int, 10>> element_block;  ///< destination of each of block_pair (isotropic.h)

    std::vector<VolumePatch> patches;            ///< empty: every element has its own volume term
    std::vector<LimitPatch> limit_patches;       ///< empty: strain limits are of elements alone
    std::vector<int> limit_nodes, limit_blocks;  ///< as LimitPatch says
    std::vector<LimitPart> limit_parts;          ///< by element, of all; empty where there are no limit patches
    std::vector<int> patch_nodes, patch_blocks;  ///< as VolumePatch says
    std::vector<std::array<int, 4>>
        element_place;  ///< [element] its nodes' places in patch_nodes, from the patch's first

    std::vector<MembranePatch> membrane_patches;  ///< empty: each membrane resists its own stretch
    std::vector<int> membrane_elements, membrane_nodes, membrane_blocks;  ///< as MembranePatch says
    std::vector<std::array<int, 4>> membrane_place;  ///< [membrane element] places of its corners in membrane_nodes,
                                                     ///< from the patch's first, ascending; last -1: of its nodes, one
                                                     ///< is below the only face that it has in the skin
    std::vector<std::array<int, 4>>
        membrane_corner;                  ///< [membrane element] these nodes; where one is missing, the first
    std::vector<char> in_membrane_patch;  ///< [element] 1: in one; empty where there are none

    std::vector<int> bone_nodes;
    struct BoneEdge {
        int block;               ///< (bone node, free node)
        int bone_node;           ///< node number
        int position, rotation;  ///< blocks (bone_position, free node), (bone_rotation, free node)
    };
    struct BonePair {
        int block;  ///< (a, b), a >= b
        int a, b;   ///< bone nodes
    };
    std::vector<BoneEdge> bone_edges;
    std::vector<BonePair> bone_pairs;
    int bone_cross_block = 0;  ///< block (rotation, position)

    std::vector<int> samples;              ///< nodes at which contact is decided
    std::vector<FaceSample> face_samples;  ///< further samples, inside faces of the pad
    std::vector<SkinCorner> skin_corners;  ///< what normals at nodes are found by, as corners_on_pad says
    /// Of a curved skin: edges of the pad's faces, and the part of each sample at a node that one of its edges has.
    /// Empty where the skin is flat between nodes.
    std::vector<SkinEdge> skin_edges;
    std::vector<double> edge_share;
    std::size_t sample_count() const { return samples.size() + face_samples.size(); }
    /// Strain limits: of the elements, then of the patches.
    std::size_t limit_count() const { return elements.size() + limit_patches.size(); }
};

/// Two nodes that share an element, or a patch of them, a not before b, and the block of their stiffness; a = b for a
/// node itself.
struct TissuePair {
    int block, a, b;
};
/// All of them, by block.
std::vector<TissuePair> tissue_pairs(const SkinTopology& topology);

/// `several_lanes`: for chunks of more than one lane, too. `sample_refinement`: 1 for samples at nodes alone, n for n
/// times as many along each edge of the pad.
SkinTopology build_topology(const TetMesh& mesh, bool several_lanes = true, int sample_refinement = 1);

/// [skin corner] whether it counts in the normal at its node: not that of a face beyond an edge of the skin, as at the
/// cut end, for a normal of both would be neither's. Fingers of one topology differ in it, as their shapes do.
std::vector<bool> corners_on_pad(const SkinTopology& topology, const TetMesh& mesh);

/// Share of the surface of every node [m^2]: a third of each triangle around it.
std::vector<double> nodal_areas(const TetMesh& mesh);

}  // namespace palpate
