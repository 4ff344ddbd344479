// A tracked hand: fingers of the scene follow the distal joints and tips of a hand as OpenXR, and Unity's XR Hands, have them.
using UnityEngine;

[AddComponentMenu("Palpate/Hand")]
public class PalpateHand : MonoBehaviour
{
    [Tooltip("Names of fingers in the scene, one per joint below")]
    public string[] fingers = { "thumb", "index", "middle", "ring", "little" };
    [Tooltip("Distal joints: XR_HAND_JOINT_THUMB_DISTAL_EXT, ...; nothing: that finger goes on by itself")]
    public Transform[] distal = new Transform[5];
    [Tooltip("Tips: XR_HAND_JOINT_THUMB_TIP_EXT, ...")]
    public Transform[] tips = new Transform[5];
    [Tooltip("Set by the tracker: the hand is seen")]
    public bool seen = true;

    PalpateWorld world;
    int[] ids;

    internal void Begin(PalpateWorld world)
    {
        this.world = world;
        ids = new int[fingers.Length];
        for (int i = 0; i < ids.Length; ++i) ids[i] = Follows(i) ? world.World.FindFinger(fingers[i]) : -1;
    }

    bool Follows(int i) { return i < distal.Length && i < tips.Length && distal[i] != null && tips[i] != null; }

    internal void Send()
    {
        for (int i = 0; i < ids.Length; ++i)
        {
            if (ids[i] < 0) continue;
            Vector3 d = world.Place(distal[i]), t = world.Place(tips[i]);
            Quaternion q = world.Turn(distal[i]);
            world.World.SetFingerPose(ids[i], seen ? Palpate.HandJoints.FingerPose(d.x, d.y, d.z, q.x, q.y, q.z, q.w, t.x, t.y, t.z) : null);
        }
    }
}
